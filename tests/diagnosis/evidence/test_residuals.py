"""Residuals: what an observer would leave of all acceleration."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.residuals import acceleration
from egophys_core.diagnosis.tracked_episode import FREE, RATE, observe
from tests.diagnosis.rehearsed import episodes, sheet

ACCELERATION = np.array([1.0, 2.0, -2.0])
"""m/s^2."""


@pytest.fixture(scope="module")
def accelerated():
    """An episode whose points all accelerate alike."""
    observation = observe(sheet(), episodes()[0])
    times = observation.episode.times[:, None, None]
    positions = np.broadcast_to(0.5 * ACCELERATION * times**2 + times, observation.tracks.positions.shape)
    return replace(observation, tracks=replace(observation.tracks, positions=positions.copy()))


def test_an_observer_leaves_its_rate_squareds_part_of_an_acceleration(accelerated):
    expected = np.sqrt(np.mean(ACCELERATION**2)) / RATE**2
    assert acceleration([accelerated]) == pytest.approx(expected, rel=0.05)


def test_what_is_not_nudged_counts_nothing(accelerated):
    assert acceleration([replace(accelerated, rate=FREE)]) == 0.0
