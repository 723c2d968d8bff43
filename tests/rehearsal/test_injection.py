"""Every effect of the library can be injected, by its name and in its parameters and units."""

import numpy as np
import pytest

from egophys_core.effects import LIBRARY
from egophys_core.errors import OptionsError
from egophys_core.rehearsal import INJECTABLE, complete_effects, injected_sizes


def test_the_whole_library_can_be_injected():
    assert len(LIBRARY) > 20
    assert INJECTABLE.keys() == LIBRARY.keys()


@pytest.mark.parametrize("name", LIBRARY)
def test_injected_and_found_values_stand_side_by_side(name):
    """The rehearsal world knows nothing of the library; it names and measures as the library does."""
    assert INJECTABLE[name].units == {each.name: each.unit for each in LIBRARY[name].parameters}


@pytest.mark.parametrize("name", INJECTABLE)
def test_sizes_are_complete_and_differ(name):
    sizes = injected_sizes(name)
    assert sizes["small"].keys() == sizes["large"].keys() == INJECTABLE[name].units.keys()
    assert sizes["small"] != sizes["large"]


def test_parameters_not_given_are_those_of_the_small_size():
    effects = complete_effects({"grasp_slip": {"z": -0.1}, "gravity_scale": {}})
    assert effects == {
        "grasp_slip": {**INJECTABLE["grasp_slip"].small, "z": -0.1},
        "gravity_scale": dict(INJECTABLE["gravity_scale"].small),
    }


def test_changing_a_size_does_not_change_the_next():
    injected_sizes("quadratic_drag")["large"]["coefficient"] = 0.0
    assert injected_sizes("quadratic_drag")["large"]["coefficient"] > 0.0


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"quadratic_drg": {}}, "unknown effect 'quadratic_drg'; did you mean 'quadratic_drag'?"),
        (
            {"grasp_slip": {"onse": 1.0}},
            "unknown parameter of grasp_slip 'onse'; did you mean 'onset'? There are x, y, z",
        ),
        ({"grasp_slip": {"onset": np.nan}}, "grasp_slip: onset must be a finite number, got nan"),
    ],
)
def test_bad_requests_say_what_is_wrong(effects, message):
    with pytest.raises(OptionsError) as raised:
        complete_effects(effects)
    assert message in str(raised.value)
