"""A twin keeps its effects, and only such as the library knows."""

from dataclasses import replace

import pytest

from egophys_core.effects import TwinEffect
from egophys_core.errors import TwinError
from egophys_core.twin import decode_twin, encode_twin
from tests.twin.examples import make_twin

DRAG = TwinEffect(name="quadratic_drag", values={"coefficient": 3.0})


def test_effects_survive_the_file():
    twin = make_twin()
    with_drag = replace(twin, model=replace(twin.model, effects=(DRAG,)))
    assert decode_twin(encode_twin(with_drag), name="twin").model.effects == (DRAG,)
    assert with_drag.twin_id != twin.twin_id


@pytest.mark.parametrize(
    "effect",
    [
        TwinEffect(name="quadratic_drug", values={"coefficient": 3.0}),
        TwinEffect(name="quadratic_drag", values={"coeficient": 3.0}),
    ],
)
def test_unknown_effects_are_refused(effect):
    twin = make_twin()
    content = encode_twin(replace(twin, model=replace(twin.model, effects=(effect,))))
    with pytest.raises(TwinError, match=r"quadratic_drag|coeficient"):
        decode_twin(content, name="twin")
