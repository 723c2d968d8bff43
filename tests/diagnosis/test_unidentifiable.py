"""What a twin cannot tell: effects of where it is held, where its nodes are few."""

import numpy as np
import pytest

from egophys_core.diagnosis.unidentifiable import is_coarse, why_not_looked_for
from egophys_core.effects import LIBRARY
from egophys_core.effects.traits import Need
from egophys_core.kinds.rest_shape import rest_shape
from egophys_core.twin import ObjectModel
from tests.identification.synthetic import known_model


def twin_of(size: tuple[float, float, float], count: int, seed: int = 0) -> ObjectModel:
    """A box on the table of so many points of its upper five faces, strewn at random."""
    random, half = np.random.default_rng(seed), np.array(size) / 2
    points = random.uniform(-half, half, (20 * count, 3))
    axis = random.choice(3, len(points), p=1 / half / (1 / half).sum())
    side = np.where(axis == 2, 1.0, random.choice([-1.0, 1.0], len(points)))
    points[np.arange(len(points)), axis] = side * half[axis]
    return known_model(rest_shape(points + [0, 0, half[2]], name="it", ground=0.0, max_nodes=count))


@pytest.mark.parametrize(("count", "coarse"), [(45, True), (160, False)])
def test_a_box_of_few_nodes_does_not_tell_where_it_is_held(count, coarse):
    box = twin_of((0.15, 0.12, 0.11), count)
    assert is_coarse(box, []) == coarse
    assert ("track more points" in why_not_looked_for(box, [])) == coarse


def test_how_thin_a_sheet_is_does_not_count():
    assert not is_coarse(twin_of((0.25, 0.2, 0.001), 60), [])


def test_what_depends_on_where_it_is_held_needs_fine_nodes():
    needing = {effect.name for effect in LIBRARY.values() if Need.FINE_NODES in effect.traits.needs}
    assert needing == {"tracking_offset", "gripper_offset", "uneven_mass"}
