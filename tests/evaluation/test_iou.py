"""Overlap of silhouettes against cases counted by hand on squared paper."""

import numpy as np
import pytest

from egophys_core.evaluation import bind_tracks, iou_per_frame
from egophys_core.evaluation.iou import DISC, point_spacing

NAN = [np.nan] * 3

# Two points 4 m apart: the point spacing is 4 m, a cell is 1 m. They are in the middles of their cells.
FIRST = np.array([[0.5, 0.5, 0.5], [4.5, 0.5, 0.5]])


def iou(predicted: list, observed: list) -> float:
    """IoU of a frame after the first one, in which both tracks lie on their vertices."""
    frames = np.array([FIRST, predicted], float), np.array([FIRST, observed], float)
    overlap = iou_per_frame(*frames, bind_tracks(FIRST, FIRST))
    assert overlap[0] == 1.0
    return float(overlap[1])


def test_point_fills_a_disc_of_49_cells():
    rows = [sum(y == row for _, y in DISC.tolist()) for row in range(-4, 5)]
    # x^2 + y^2 <= 16: up to 0, 2, 3, 3, 4, 3, 3, 2, 0 cells to either side.
    assert rows == [1, 5, 7, 7, 9, 7, 7, 5, 1]


@pytest.mark.parametrize(
    ("shift", "expected"),
    [
        # By one cell each of the nine rows loses one: 40 in both, 58 in either.
        ([1, 0, 0], (40 / 58 + 40 / 58 + 1) / 3),
        ([0, 0, -1], (1 + 40 / 58 + 40 / 58) / 3),
        # By two cells 7 + 4 * 5 + 2 * 3 = 33 are left.
        ([0, 2, 0], (33 / 65 + 1 + 33 / 65) / 3),
        # Diagonally by one cell the rows have 1, 5, 6, 7, 7, 6, 5, 1 = 38 in common.
        ([1, 1, 0], (38 / 60 + 40 / 58 + 40 / 58) / 3),
        # Nine cells away the discs do not touch, in the view along the shift they are the same.
        ([9, 0, 0], 1 / 3),
        ([9, 9, 9], 0.0),
        # Within its cell a point fills the same cells.
        ([0.4, -0.4, 0.4], 1.0),
    ],
)
def test_one_visible_point_off_by_some_cells(shift, expected):
    observed = [[0.5, 0.5, 0.5], NAN]
    assert iou([np.add(FIRST[0], shift), [9, 9, 9]], observed) == pytest.approx(expected)


def test_overlapping_discs_of_one_surface_count_once():
    # Four cells apart discs share 5 + 4 * 3 + 2 * 1 = 19 cells: two cover 79 along y and z, along x 49.
    # The second vertex is on the first point.
    assert iou([FIRST[0], FIRST[0]], FIRST) == pytest.approx((49 / 79 + 49 / 79 + 1) / 3)


def test_motion_along_the_surface_does_not_count():
    assert iou(FIRST[::-1], FIRST) == 1.0


def test_part_that_is_hidden_is_not_held_against_the_prediction():
    generator = np.random.default_rng(0)
    truth = np.cumsum(generator.normal(0, 0.02, (12, 40, 3)), axis=0) + generator.uniform(0, 0.3, (40, 3))
    points = truth.copy()
    points[1:, :30] = NAN
    assert iou_per_frame(truth, points, bind_tracks(points[0], truth[0])).tolist() == [1.0] * 12
    # What is seen is: the ten visible tracks of the last frame elsewhere, the hidden ones in place.
    wrong = truth.copy()
    wrong[-1, 30:] += 10.0
    assert iou_per_frame(wrong, points, bind_tracks(points[0], truth[0]))[-1] == 0.0


def test_track_not_seen_in_the_first_frame_never_counts():
    points = np.array([[*FIRST, NAN], [*FIRST, [50.0, 50, 50]]])
    predicted = np.array([FIRST, FIRST])
    assert iou_per_frame(predicted, points, bind_tracks(points[0], FIRST)).tolist() == [1.0, 1.0]


def test_farther_off_is_worse_and_the_order_of_the_two_does_not_matter():
    # Steps of two and one cells of 5 mm, coordinates in the middles of cells.
    axis = np.arange(10) * 0.02
    sheet = np.stack(np.meshgrid(axis, axis, [0.0]), axis=-1).reshape(-1, 3) + 0.0025
    shifts = np.arange(12)[:, None, None] * [0.01, 0.0, 0.005]
    truth, moved = np.repeat(sheet[None], 12, axis=0), sheet + shifts
    bound = np.arange(len(sheet))
    overlap = iou_per_frame(moved, truth, bound)
    assert (np.diff(overlap) < 0).all()
    # Binding and spacing come from frame 0, where both are equal.
    assert np.array_equal(iou_per_frame(truth, moved, bound), overlap)


def test_unit_does_not_matter():
    generator = np.random.default_rng(1)
    points = generator.uniform(0, 1, (3, 30, 3))
    predicted = points + np.array([0, 0.05, 0.2])[:, None, None]
    bound = np.arange(30)
    overlap = iou_per_frame(predicted, points, bound)
    assert 0 < overlap[2] < overlap[1] < overlap[0] == 1.0
    # By a power of two, so that no coordinate is rounded into another cell.
    assert np.array_equal(iou_per_frame(predicted / 1024, points / 1024, bound), overlap)


def test_frame_without_visible_bound_tracks_has_no_overlap():
    points = np.array([FIRST, [NAN, NAN]])
    overlap = iou_per_frame(np.array([FIRST, FIRST]), points, bind_tracks(FIRST, FIRST))
    assert overlap[0] == 1.0
    assert np.isnan(overlap[1])


@pytest.mark.parametrize("first", [[FIRST[0], NAN], [FIRST[0], FIRST[0]]])
def test_without_a_point_spacing_there_is_no_overlap(first):
    points = np.array([first, first])
    assert np.isnan(iou_per_frame(points[:, :1], points, np.array([0, -1]))).all()


def test_vertex_that_flew_off_is_just_wrong():
    assert iou([[1e30, 1e30, -1e30], FIRST[1]], [FIRST[0], NAN]) == 0.0


def test_point_spacing_of_a_grid_is_its_pitch_and_hidden_points_do_not_count():
    axis = np.arange(9) * 0.5
    grid = np.stack(np.meshgrid(axis, axis, [0.3]), axis=-1).reshape(-1, 3)
    assert point_spacing(grid) == 0.5
    assert point_spacing(np.concatenate([grid, np.full((500, 3), np.nan)])) == 0.5
    assert np.isnan(point_spacing(grid[:1]))
