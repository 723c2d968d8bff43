"""Tracks beside nodes: places are found again, and smoothing keeps what moves."""

import numpy as np
import pytest

from egophys_core.diagnosis.observed_tracks import observed_tracks, smoothed
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.observation import observe_episode
from tests.diagnosis.rehearsed import episodes, sheet
from tests.simulation.scenes import frame_times

TIMES = frame_times(1.0, 1 / 30)


def test_smoothing_keeps_a_parabola_and_its_velocity():
    tracks = np.zeros((len(TIMES), 2, 3))
    tracks[:, 0, 0] = 0.3 * TIMES**2
    positions, velocities = smoothed(tracks, TIMES)
    inner = slice(3, -3)
    assert positions[inner] == pytest.approx(tracks[inner], abs=1e-9)
    assert velocities[inner, 0, 0] == pytest.approx(0.6 * TIMES[inner], abs=1e-9)


def test_what_is_hidden_too_long_has_no_place():
    tracks = np.zeros((len(TIMES), 1, 3))
    tracks[10:20] = np.nan
    positions, _ = smoothed(tracks, TIMES)
    assert np.isnan(positions[15]).all()
    assert np.isfinite(positions[[2, 28]]).all()


def test_parabola_is_kept_where_frames_come_unevenly():
    random = np.random.default_rng(1)
    times = np.cumsum(random.uniform(0.06, 0.28, 40))
    tracks = np.stack([times**2, 3.0 * times, np.ones_like(times)], axis=1)[:, None]
    positions, velocities = smoothed(tracks, times)
    inner = slice(3, -3)
    assert positions[inner] == pytest.approx(tracks[inner], abs=1e-9)
    slopes = np.stack([2 * times, 3 + 0 * times, 0 * times], axis=1)
    assert velocities[inner, 0] == pytest.approx(slopes[inner], abs=1e-9)


def test_tracks_lie_where_they_were_seen_at_rest():
    observation = observe(sheet(), episodes(noise_m=0.0)[0])
    still = observation.tracks.on_twin(observation.problem.start[None].astype(float))[0]
    assert still == pytest.approx(observation.rest, abs=2e-3)
    assert np.asarray(observation.tracks.weights.sum(axis=1)).ravel() == pytest.approx(1.0)


def test_a_track_moves_with_its_nodes():
    observed = observe_episode(episodes()[0])
    observation = observe(sheet(), observed)
    tracks = observed_tracks(observation.problem, sheet().graph.surface, observed)
    nodes = observation.problem.start.astype(float)
    turned = nodes @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).T + [0.1, 0.2, 0.3]
    before, after = tracks.on_twin(np.stack([nodes, turned]))
    distances = [np.linalg.norm(each[:, None] - each[None], axis=2) for each in (before, after)]
    assert distances[0] == pytest.approx(distances[1], abs=1e-9)
