"""Filters of tracked points against motions that are written down here."""

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.stages import Masks, Tracks
from egophys_core.perception.surface.track_filter import (
    FEWEST_NEIGHBOURS,
    above_ground,
    consistent_motion,
    first_neighbours,
    inside_mask,
    mask_hits,
    stays_in_mask,
    visible_throughout,
)


def sheet(views: int, side: int = 8, spacing: float = 0.01) -> np.ndarray:
    """[T, side * side, 3] metres: a sheet that moves along x and turns about z, a degree a view."""
    rows, columns = np.mgrid[:side, :side] * spacing
    flat = np.stack([columns.ravel(), rows.ravel(), np.zeros(side * side)], axis=1)
    angles = np.radians(np.arange(views))
    turned = [flat @ np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in angles]
    return np.stack(turned) + np.arange(views)[:, None, None] * [0.02, 0, 0]


def half_masks(size: int = 20) -> Masks:
    left = np.zeros((size, size), bool)
    left[:, : size // 2] = True
    return Masks(object=left, hand=~left)


@pytest.mark.parametrize(
    ("place", "margin", "inside"),
    [
        ((4.4, 2.0), 0, True),
        ((4.6, 2.0), 0, False),
        ((4.6, 2.0), 1, True),
        ((5.6, 2.0), 1, False),
        ((-0.4, 2.0), 0, True),
        ((-0.6, 2.0), 1, False),
        ((np.nan, 2.0), 5, False),
        ((2.0, np.inf), 5, False),
    ],
)
def test_inside_mask_is_of_the_nearest_pixel_and_of_the_margin(place, margin, inside):
    mask = np.zeros((8, 8), bool)
    mask[:, :5] = True
    assert inside_mask(mask, np.array([place]), margin=margin).tolist() == [inside]


def test_tracks_are_told_apart_by_the_masks():
    pixels = np.array([[[2, 5], [17, 5], [2, 9]], [[3, 5], [18, 5], [17, 9]]], np.float32)
    visible = np.array([[True, True, True], [True, False, True]])
    hits = mask_hits(Tracks(pixels=pixels, visible=visible), (half_masks() for _ in range(2)))
    assert hits.object.tolist() == [[True, False, True], [True, False, False]]
    assert hits.hand.tolist() == [[False, True, False], [False, False, True]]


@pytest.mark.parametrize("pairs", [0, 1, 3])
def test_masks_are_asked_for_each_view(pairs):
    tracks = Tracks(pixels=np.zeros((2, 1, 2), np.float32), visible=np.ones((2, 1), bool))
    with pytest.raises(EpisodeError, match="for 2 tracked views"):
        mask_hits(tracks, [half_masks()] * pairs)


def test_tracks_that_slide_off_their_mask_are_not_kept():
    hits = np.ones((10, 4), bool)
    hits[5:, 1] = False  # slides off
    hits[:, 2] = False  # hidden in all views
    hits[9, 3] = False  # one view beside the mask
    visible = np.ones((10, 4), bool)
    visible[:, 2] = False
    assert stays_in_mask(hits, visible).tolist() == [True, False, False, True]


def test_hidden_views_do_not_count_against_a_track():
    hits = np.zeros((10, 1), bool)
    hits[:2] = True
    assert stays_in_mask(hits, hits).tolist() == [True]


def test_a_moving_turning_sheet_is_consistent():
    assert consistent_motion(sheet(12), bound=0.003).all()


def test_only_the_jumping_point_is_dropped_and_only_while_it_is_away():
    points = sheet(12)
    points[4:7, 20] += [0.05, 0.0, 0.0]
    expected = np.ones(points.shape[:2], bool)
    expected[4:7, 20] = False
    assert (consistent_motion(points) == expected).all()


def test_a_point_that_stays_behind_is_dropped_for_good():
    points = sheet(12)
    points[5:, 20] = points[4, 20]
    kept = consistent_motion(points)
    assert not kept[5:, 20].any()
    assert np.delete(kept, 20, axis=1).all()


def test_a_point_hidden_for_a_while_is_judged_by_the_motion_since_then():
    points = sheet(12)
    points[3:9, 20:30] = np.nan
    back_wrong = points.copy()
    back_wrong[9:, 20] += [0.0, 0.03, 0.0]
    assert consistent_motion(points)[9:, 20:30].all()
    kept = consistent_motion(back_wrong)
    assert not kept[9:, 20].any()
    assert kept[9:, 21:30].all()


def test_points_first_seen_late_get_the_neighbours_they_have_then():
    points = sheet(12)
    points[:6, 30] = np.nan
    points[9, 30] += [0.0, 0.05, 0.0]
    assert consistent_motion(points)[:, 30].tolist() == [False] * 6 + [True] * 3 + [False] + [True] * 2


def test_nothing_is_said_of_points_with_too_few_neighbours():
    points = np.random.default_rng(0).uniform(-1, 1, (5, FEWEST_NEIGHBOURS, 3))
    assert consistent_motion(points).all()


@pytest.mark.parametrize("shape", [(5, 0, 3), (0, 4, 3)])
def test_no_points_or_views_is_no_error(shape):
    assert consistent_motion(np.zeros(shape)).shape == shape[:2]


def test_never_seen_points_are_not_kept():
    points = sheet(3)
    points[:, 5] = np.nan
    assert not consistent_motion(points)[:, 5].any()


def test_points_of_another_shape_are_refused():
    with pytest.raises(EpisodeError, match=r"\[T, N, 3\]"):
        consistent_motion(np.zeros((4, 5, 2)))


def test_neighbours_are_the_nearest_and_never_the_point_itself():
    points = np.array([[[0, 0, 0], [1, 0, 0], [3, 0, 0], [0, 0, 0], [7, 0, 0]]], float)
    around = first_neighbours(points, 2)
    assert all(index not in row for index, row in enumerate(around))
    assert sorted(around[1]) == [0, 3]
    assert sorted(around[4]) == [1, 2]
    assert first_neighbours(points[:, :2], 3).tolist() == [[1, -1, -1], [0, -1, -1]]


def test_many_coincident_points_still_have_only_others_as_neighbours():
    around = first_neighbours(np.zeros((1, 9, 3)), 4)
    assert all(index not in row for index, row in enumerate(around))
    assert (around >= 0).all()


def test_controllers_are_those_seen_throughout():
    seen = np.ones((10, 4), bool)
    seen[0, 1] = False
    seen[4:7, 2] = False
    seen[:, 3] = False
    assert visible_throughout(seen).tolist() == [True, False, False, False]
    assert visible_throughout(seen, longest_gap=1).tolist() == [True, True, False, False]
    assert visible_throughout(seen, longest_gap=3).tolist() == [True, True, True, False]


def test_points_below_the_ground_are_not_kept():
    points = np.array([[0, 0, 0.1], [0, 0, -0.004], [0, 0, -0.006], [0, np.nan, 0.1]])
    assert above_ground(points, 0.0).tolist() == [True, True, False, False]
    assert above_ground(points, -0.01).tolist() == [True, True, True, False]
