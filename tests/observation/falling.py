"""A ball that hands lift, hold and let go, and that falls at once."""

import numpy as np

from egophys_core.episode import Episode
from tests.observation.test_contact import ABOVE, HOVER, ball, carried, fingers, observed, path, seconds

LIFTED = 0.45
"""Metres."""


def dropped(
    let_go: float,
    *,
    rate: float = 30.0,
    noise: float = 0.0015,
    acceleration: tuple[float, float, float] = (0.0, 0.0, -9.81),
    drag: float = 0.0,
    seed: int = 0,
) -> Episode:
    """Let go at a time in seconds; recorded until it is about to land.

    Args:
        acceleration: [3] m/s^2 of what falls.
        drag: what air takes of its speed squared, 1/m.
        seed: of the noise.
    """
    times = seconds(let_go + 0.34, rate)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.2, ABOVE + [0, 0, LIFTED]))
    moved = carried(times, hand, (1.0, times[-1]))
    step, place, speed, now = 1e-4, np.zeros(3), np.zeros(3), 0.0
    for frame in np.flatnonzero(times > let_go):
        while now < times[frame] - let_go:
            speed = speed + step * (np.array(acceleration) - drag * np.linalg.norm(speed) * speed)
            place, now = place + step * speed, now + step
        moved[frame] += place
    return observed(times, ball() + moved[:, None], fingers(hand), noise, seed)
