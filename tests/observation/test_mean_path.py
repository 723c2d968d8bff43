"""How something moves on the whole whose points are seen now and then."""

import numpy as np
import pytest

from egophys_core.observation.mean_path import mean_path, points_seen_mostly


def moving(seed: int = 0) -> np.ndarray:
    """[12, 40, 3] points that move together."""
    random = np.random.default_rng(seed)
    return random.normal(size=(1, 40, 3)) + np.cumsum(random.normal(size=(12, 1, 3)), axis=0)


def test_of_points_that_are_always_seen_it_is_the_mean():
    points = moving() + np.random.default_rng(1).normal(0.0, 0.1, (12, 40, 3))
    assert mean_path(points) == pytest.approx(points.mean(axis=1), abs=1e-9)


def test_what_is_hidden_now_and_then_does_not_move_it():
    points = moving()
    seen = np.where(np.random.default_rng(2).random((12, 40, 1)) < 0.4, np.nan, points)
    assert np.abs(np.nanmean(seen, axis=1) - points.mean(axis=1)).max() > 0.1
    assert mean_path(seen) == pytest.approx(points.mean(axis=1), abs=1e-6)


def test_a_frame_that_shows_nothing_tells_nothing():
    points = moving()
    points[3] = np.nan
    found = mean_path(points)
    assert np.isnan(found[3]).all()
    assert np.isfinite(np.delete(found, 3, axis=0)).all()


def test_points_that_are_hidden_in_half_of_the_frames_are_left_out():
    points = moving()
    points[:6, 0] = np.nan
    points[:4, 1] = np.nan
    assert points_seen_mostly(points).tolist() == [*range(1, 40)]
