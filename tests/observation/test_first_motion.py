"""How markers move when a record begins."""

import numpy as np
import pytest

from egophys_core.observation.first_motion import first_motion


def oscillation(rate: float, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Times, and places of three points that swing by 0.1 m at 1 Hz, each at another phase."""
    times = np.arange(frames) / rate
    phases = np.array([0.0, 1.0, 2.0])
    return times, 0.1 * np.sin(2.0 * np.pi * times[:, None, None] + phases[:, None] + np.array([0.0, 0.5, 1.0]))


@pytest.mark.parametrize("rate", [30.0, 100.0, 240.0])
def test_an_oscillation_begins_as_fast_as_it_is(rate: float) -> None:
    times, places = oscillation(rate, 100)
    noisy = places + np.random.default_rng(0).normal(0.0, 2e-4, places.shape)
    phases = np.array([[0.0], [1.0], [2.0]]) + np.array([0.0, 0.5, 1.0])
    first, velocities = first_motion(noisy, times)
    assert first == pytest.approx(places[0], abs=6e-4)
    assert velocities == pytest.approx(0.2 * np.pi * np.cos(phases), abs=0.05)


def test_what_is_at_rest_begins_nearly_at_rest() -> None:
    noisy = np.random.default_rng(0).normal(0.0, 2e-4, (50, 200, 3))
    first, velocities = first_motion(noisy, 0.01 * np.arange(50))
    assert first.std() < 2e-4
    assert velocities.std() < 0.025


def test_points_that_are_hidden_early_are_taken_to_move_simply() -> None:
    times = 0.01 * np.arange(20)
    places = np.repeat((0.3 * times)[:, None, None], 3, axis=1) * np.array([1.0, 0.0, 0.0])
    places[1:, 0] = np.nan
    places[[1, 2, 4, 5, 6, 7, 8], 1] = np.nan
    first, velocities = first_motion(places, times)
    assert first == pytest.approx(0.0, abs=1e-9)
    assert velocities[:, 0] == pytest.approx([0.0, 0.0, 0.3], abs=1e-9)
    places[4, 1] = [0.3 * times[4], 0.0, 0.0]
    assert first_motion(places, times)[1][1, 0] == pytest.approx(0.3, abs=1e-9)


def test_a_record_of_two_frames_is_taken_to_begin_at_rest() -> None:
    times, places = oscillation(100.0, 2)
    first, velocities = first_motion(places, times)
    assert first == pytest.approx(places[0])
    assert (velocities == 0.0).all()
