"""Metrics against cases worked by hand, as PhysTwin's evaluation defines them."""

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.evaluation import (
    bind_tracks,
    chamfer_per_frame,
    score,
    split_frames,
    track_error_per_frame,
    two_way_chamfer,
    two_way_chamfer_per_frame,
)
from tests.identification.synthetic import episode_of

NAN = [np.nan] * 3


def episode(points: np.ndarray):
    return episode_of(points, np.zeros((len(points), 1, 3)))


def test_chamfer_is_the_mean_l1_distance_to_the_nearest_vertex_one_way():
    surface = np.array([[[0, 0, 0], [10, 0, 0]]], float)
    points = np.array([[[1, 2, 3], [9, 0, -1]]], float)
    # |1|+|2|+|3| = 6 and |1|+|0|+|1| = 2; the way back would not be 4.
    assert chamfer_per_frame(surface, points).tolist() == [4.0]
    assert chamfer_per_frame(surface, points[:, :1]).tolist() == [6.0]


def test_nearest_of_the_chamfer_distance_is_nearest_in_l1():
    # From the origin: (1.5, 0, 0) has L1 1.5, (1, 1, 0) has L1 2 but the smaller L2 1.41.
    surface = np.array([[[1.5, 0, 0], [1, 1, 0]]], float)
    assert chamfer_per_frame(surface, np.zeros((1, 1, 3))).tolist() == [1.5]


def test_points_not_seen_do_not_count_in_the_chamfer_distance():
    surface = np.zeros((2, 1, 3))
    points = np.array([[[1, 0, 0], NAN], [NAN, NAN]])
    errors = chamfer_per_frame(surface, points)
    assert errors[0] == 1.0
    assert np.isnan(errors[1])


def test_tracks_are_bound_to_their_nearest_vertex_of_the_first_frame():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], float)
    assert bind_tracks(np.array([[1.9, 0, 0], NAN, [0.4, 0, 0]]), vertices).tolist() == [2, -1, 0]


def test_track_error_follows_the_bound_vertex_even_past_a_nearer_one():
    # The track stays at 0; its vertex (bound at frame 0) moves to 3 while the other comes to 0.1.
    predicted = np.array([[[0.2, 0, 0], [5, 0, 0]], [[3, 4, 0], [0.1, 0, 0]]], float)
    points = np.zeros((2, 1, 3))
    bound = bind_tracks(points[0], predicted[0])
    assert bound.tolist() == [0]
    assert track_error_per_frame(predicted, points, bound) == pytest.approx([0.2, 5.0])


def test_track_error_averages_over_the_tracks_seen_in_that_frame():
    predicted = np.zeros((3, 2, 3))
    points = np.array([[[1, 0, 0], [3, 0, 0]], [NAN, [3, 0, 0]], [NAN, NAN]], float)
    errors = track_error_per_frame(predicted, points, np.array([0, 1]))
    assert errors[:2].tolist() == [2.0, 3.0]
    assert np.isnan(errors[2])


def test_track_not_seen_in_the_first_frame_never_counts():
    predicted = np.zeros((2, 1, 3))
    points = np.array([[[0, 0, 0], NAN], [[1, 0, 0], [100, 0, 0]]], float)
    bound = bind_tracks(points[0], predicted[0])
    assert track_error_per_frame(predicted, points, bound).tolist() == [0.0, 1.0]


def test_two_way_chamfer_averages_both_ways():
    one, other = np.array([[0, 0, 0], [3.0, 4.0, 0]]), np.array([[0.0, 0, 0]])
    # There: (0 + 5) / 2, back: 0.
    assert two_way_chamfer(one, other) == pytest.approx(1.25)
    assert two_way_chamfer(other, one) == pytest.approx(1.25)


def test_two_way_chamfer_of_an_episode_leaves_out_vertices_of_hidden_tracks():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [9, 0, 0]], float)
    predicted = np.array([vertices, vertices + [0, 0.3, 0.4], vertices])
    points = np.array([vertices, vertices, [[2, 0, 0], NAN, NAN]])
    points[1, 2] = NAN
    errors = two_way_chamfer_per_frame(predicted, points, bind_tracks(points[0], vertices))
    # 0.5 both ways in frame 1; in frame 2 vertex 0 is 2 from its track, the nearer vertex 1 belongs to a hidden one.
    assert errors == pytest.approx([0.0, 0.5, 2.0])


def test_two_way_chamfer_of_an_episode_is_not_the_track_error():
    # Two tracks that change places leave the set of points the same.
    vertices = np.array([[0, 0, 0], [1, 0, 0]], float)
    points = np.array([vertices, vertices[::-1], [NAN, NAN]])
    errors = two_way_chamfer_per_frame(np.repeat(vertices[None], 3, axis=0), points, np.array([0, 1]))
    assert errors[:2].tolist() == [0.0, 0.0]
    assert np.isnan(errors[2])


@pytest.mark.parametrize(
    ("frames", "split"), [(4, 2), (9, 6), (10, 7), (11, 7), (30, 21), (100, 70), (101, 70), (1000, 700)]
)
def test_train_frames_are_the_first_70_percent_without_the_first_and_the_rest_is_test(frames, split):
    parts = split_frames(episode(np.zeros((frames, 1, 3))))
    assert split == frames * 7 // 10
    index = np.arange(frames)
    assert index[parts["train"]].tolist() == list(range(1, split))
    assert index[parts["test"]].tolist() == list(range(split, frames))
    assert index[parts["all"]].tolist() == list(range(1, frames))


def test_every_length_is_split_at_the_floor_of_70_percent():
    for frames in range(4, 600):
        parts = split_frames(episode(np.zeros((frames, 1, 3))))
        assert parts["test"].start == frames * 7 // 10, frames


@pytest.mark.parametrize("frames", [2])
def test_episode_too_short_to_split_is_refused(frames):
    with pytest.raises(EpisodeError, match="synthetic: 2 frames leave 0 to fit and 1 to hold out; record at least 4"):
        split_frames(episode(np.zeros((frames, 1, 3))))


def test_score_averages_frames_of_each_part():
    # Ten frames, the prediction is off by the frame's number in mm along x; train 1..6, test 7..9.
    points = np.zeros((10, 2, 3))
    points[:, 1, 1] = 1.0
    predicted = points.copy()
    predicted[:, :, 0] += np.arange(10)[:, None] * 1e-3
    scores = score(predicted, np.ones(2, bool), episode(points))
    assert scores.train_track_m == pytest.approx(3.5e-3)
    assert scores.test_track_m == pytest.approx(8e-3)
    assert scores.all_track_m == pytest.approx(5e-3)
    assert scores.train_chamfer_m == pytest.approx(3.5e-3)
    assert scores.test_chamfer_m == pytest.approx(8e-3)
    assert scores.all_chamfer_m == pytest.approx(5e-3)
    assert scores.test_two_way_chamfer_m == pytest.approx(8e-3)
    # Two points 1 m apart: no error of some millimetres leaves its cell of a quarter of a metre.
    assert (scores.train_iou, scores.test_iou, scores.all_iou) == (1.0, 1.0, 1.0)
    assert set(scores.as_dict()) == {
        f"{part}_{metric}"
        for part in ("train", "test", "all")
        for metric in ("chamfer_m", "track_m", "two_way_chamfer_m", "iou")
    }


def test_vertices_inside_the_object_do_not_count():
    points = np.zeros((10, 1, 3))
    predicted = np.zeros((10, 2, 3))
    predicted[:, 0, 2] = 0.01
    assert score(predicted, np.array([True, False]), episode(points)).all_chamfer_m == pytest.approx(0.01)
    assert score(predicted, np.array([True, True]), episode(points)).all_chamfer_m == 0.0


def test_frames_without_visible_points_are_left_out_of_the_mean():
    points = np.zeros((10, 1, 3), np.float32)
    points[8:] = np.nan
    predicted = np.full((10, 1, 3), 0.0)
    predicted[:, :, 0] = np.arange(10)[:, None] * 1e-3
    scores = score(predicted, np.ones(1, bool), episode(points))
    assert scores.test_track_m == pytest.approx(7e-3)
    points[7:] = np.nan
    assert np.isnan(score(predicted, np.ones(1, bool), episode(points)).test_track_m)
