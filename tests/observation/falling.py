"""A ball that hands lift, hold and let go, and that falls at once."""

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.episode import Episode
from tests.observation.test_contact import ABOVE, HOVER, RADIUS, ball, carried, fingers, observed, path, seconds

LIFTED = 0.45
"""Metres."""


SLOWS_S = 0.15
"""Seconds in which a hand moves aside; two thirds of them before it lets go."""


def dropped(
    let_go: float,
    *,
    rate: float = 30.0,
    noise: float = 0.0015,
    acceleration: tuple[float, float, float] = (0.0, 0.0, -9.81),
    drag: float = 0.0,
    aside: float = 0.0,
    spin: float = 0.0,
    seed: int = 0,
) -> Episode:
    """Let go at a time in seconds; recorded until it is about to land.

    Args:
        acceleration: [3] m/s^2 of what falls.
        drag: what air takes of its speed squared, 1/m.
        aside: metres by which the hand moves aside as it lets go.
        spin: rad/s about the y axis at which it turns as it falls; seen from -y, and that half of it alone.
        seed: of the noise.
    """
    times, up = seconds(let_go + 0.34, rate), ABOVE + [0, 0, LIFTED]
    begins = let_go - 2.0 / 3.0 * SLOWS_S
    hand = path(
        times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.2, up), (begins, up), (begins + SLOWS_S, up + [aside, 0, 0])
    )
    moved = carried(times, hand, (1.0, let_go))
    # Two thirds of the time are 20 / 27 of the way, at 4 / 3 of its mean speed.
    begin, speed = [aside * 20.0 / 27.0, 0.0, LIFTED], np.array([aside * 4.0 / 3.0 / SLOWS_S, 0.0, 0.0])
    step, place, now = 1e-4, np.array(begin), 0.0
    for frame in np.flatnonzero(times > let_go):
        while now < times[frame] - let_go:
            speed = speed + step * (np.array(acceleration) - drag * np.linalg.norm(speed) * speed)
            place, now = place + step * speed, now + step
        moved[frame] = place
    turns = Rotation.from_rotvec(np.outer(spin * np.maximum(times - let_go, 0.0), [0.0, 1.0, 0.3]))
    middle = np.array([0.0, 0.0, RADIUS])
    points = middle + np.stack([each.apply(ball() - middle) for each in turns])
    if spin:
        points[points[..., 1] > 0.0] = np.nan
    return observed(times, points + moved[:, None], fingers(hand), noise, seed)
