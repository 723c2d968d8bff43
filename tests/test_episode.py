"""What an episode must be."""

import dataclasses

import numpy as np
import pytest

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError


def episode(**changes) -> Episode:
    """Three frames of two points and one controller."""
    points = np.arange(18, dtype=np.float32).reshape(3, 2, 3) / 10
    good = {
        "name": "towel",
        "times": np.array([0.0, 0.1, 0.2]),
        "points": points,
        "confidence": np.ones((3, 2), np.float32),
        "point_ids": np.array([4, 9], np.uint32),
        "controllers": np.zeros((3, 1, 3), np.float32),
        "controller_ids": np.array([7], np.uint32),
    }
    return Episode(**{**good, **changes})


def with_value(value: float, frame: int, point: int) -> np.ndarray:
    points = episode().points.copy()
    points[frame, point, 1] = value
    return points


def test_point_is_seen_where_all_of_it_is_finite():
    seen = episode(points=with_value(np.nan, 1, 0)).visible
    assert seen.tolist() == [[True, True], [False, True], [True, True]]


@pytest.mark.parametrize(("frames", "fitted"), [(2, 1), (3, 2), (10, 7), (90, 63), (100, 70), (101, 70)])
def test_first_70_percent_of_the_frames_are_fitted(frames, fitted):
    long = episode(
        times=np.arange(frames) / 30,
        points=np.zeros((frames, 2, 3), np.float32),
        confidence=np.ones((frames, 2), np.float32),
        controllers=np.zeros((frames, 1, 3), np.float32),
    )
    assert (long.frames, long.train_frames) == (frames, fitted)


def test_episode_is_not_changed_in_place():
    with pytest.raises(dataclasses.FrozenInstanceError):
        episode().name = "other"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"points": np.zeros((3, 2, 2))}, r"object points must be \[T, N, 3\] in metres, got \(3, 2, 2\)"),
        ({"points": np.zeros((3, 6))}, r"object points must be .*got \(3, 6\)"),
        ({"points": np.zeros((1, 2, 3))}, r"1 frame\(s\); motion needs at least 2"),
        ({"points": np.zeros((3, 0, 3))}, "no object points at all"),
        ({"controllers": np.zeros((2, 1, 3))}, r"controller points must be \[3, C, 3\] in metres, got \(2, 1, 3\)"),
        ({"times": np.zeros(2)}, r"times must be \(3,\), got \(2,\)"),
        ({"confidence": np.ones((3, 1))}, r"confidence must be \(3, 2\), got \(3, 1\)"),
        ({"point_ids": np.arange(3)}, r"point_ids must be \(2,\), got \(3,\)"),
        ({"controller_ids": np.arange(2)}, r"controller_ids must be \(1,\), got \(2,\)"),
        ({"times": np.array([0.0, 0.2, 0.2])}, r"time does not increase at frame 2 \(t=0.200 s\)"),
        ({"times": np.array([0.0, np.nan, 0.2])}, "time does not increase at frame 1"),
        ({"times": np.array([0.0, 1e-7, 2e-7])}, "3 frames span 2e-07 s, .* times must be in seconds"),
        ({"times": np.array([0.0, 0.1, 710407499.5])}, r"710407499.400 s pass from frame 1 \(t=0.100 s\) to frame 2 "),
        ({"controllers": np.full((3, 1, 3), np.nan)}, "controller 7 is not finite at frame 0; drop that controller"),
        ({"points": with_value(np.inf, 1, 1)}, "point 9 is infinite at frame 1"),
        ({"points": with_value(np.nan, 0, 0) * [[[1]], [[1]], [[1]]] * np.nan}, "no object point is visible"),
        ({"points": with_value(250.0, 2, 0)}, "a coordinate of 250 m among the points, .*millimetres"),
        ({"controllers": np.full((3, 1, 3), -1e30)}, r"a coordinate of 1e\+30 m among the controllers, .*millimetres"),
    ],
)
def test_ill_formed_episodes_are_refused_with_their_name(change, text):
    with pytest.raises(EpisodeError, match=f"towel: {text}"):
        episode(**change)
