"""What the outline of the object says of vertices beside it and places without any."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from egophys_core.perception.masks.silhouette import OUTSIDE_PX, REACH_PX, inside, outliers, uncovered
from egophys_core.perception.stages import Masks

SIZE = (80, 100)


def masks(hand: bool = False) -> Masks:
    found = np.zeros(SIZE, bool)
    found[20:60, 30:70] = True
    there = np.zeros(SIZE, bool)
    if hand:
        there[20:60, 70:90] = True
    return Masks(object=found, hand=there)


def test_vertices_outside_are_sent_to_the_nearest_place() -> None:
    vertices = np.array([[50.0, 40], [80, 40], [50, 10], [69.0 + OUTSIDE_PX - 0.6, 40], [20, 10]])
    found, places = outliers(vertices, masks())
    np.testing.assert_array_equal(found, [1, 2, 4])
    np.testing.assert_allclose(places, [[69, 40], [50, 20], [30, 20]])


def test_the_hand_may_hide_a_vertex() -> None:
    found, _ = outliers(np.array([[80.0, 40]]), masks(hand=True))
    assert len(found) == 0


def test_without_any_mask_nothing_is_said() -> None:
    nothing = Masks(object=np.zeros(SIZE, bool), hand=np.zeros(SIZE, bool))
    assert len(outliers(np.array([[80.0, 40]]), nothing)[0]) == 0
    assert len(uncovered(np.array([[80.0, 40]]), nothing.object, nothing)[0]) == 0


def test_covered_object_asks_for_nothing() -> None:
    assert len(uncovered(np.array([[50.0, 40]]), masks().object, masks())[0]) == 0


def test_uncovered_part_draws_its_nearest_vertices() -> None:
    covered = masks().object.copy()
    covered[:, 55:] = False
    vertices = np.array([[32.0, 40], [54.0, 25], [54.0, 55]])
    found, places = uncovered(vertices, covered, masks())
    assert len(found) > 10
    assert set(found) == {1, 2}
    assert (places[:, 0] > 55).all()
    assert masks().object[places[:, 1].astype(int), places[:, 0].astype(int)].all()
    np.testing.assert_array_less(np.linalg.norm(vertices[found] - places, axis=1), REACH_PX)


def test_far_places_draw_nothing() -> None:
    found, _ = uncovered(np.array([[0.0, 0]]), np.zeros(SIZE, bool), masks())
    assert len(found) == 0


@settings(max_examples=50, deadline=None)
@given(
    npst.arrays(float, (6, 2), elements=st.floats(-1e7, 1e7) | st.just(float("nan"))),
    npst.arrays(bool, SIZE, elements=st.booleans()),
)
def test_wild_vertices_and_masks(vertices: np.ndarray, mask: np.ndarray) -> None:
    found, places = outliers(vertices, Masks(object=mask, hand=np.zeros(SIZE, bool)))
    assert len(found) == len(places)
    if len(places):
        assert mask[places[:, 1].astype(int), places[:, 0].astype(int)].all()
    pixels = inside(vertices, SIZE)
    assert (pixels >= 0).all()
    assert (pixels < [SIZE[1], SIZE[0]]).all()
