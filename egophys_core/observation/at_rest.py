"""The object before any hand moves it."""

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.contact import SeenHands

HELD_STILL_M = 0.005
"""Metres: hands that hold from the first frame on and have moved no farther have not moved the object yet."""


def observed_at_rest(episode: Episode, seen: SeenHands) -> tuple[int, np.ndarray]:
    """Frame of the first contact, and [P, 3] metres: where the points seen mostly before it are.

    Before hands take hold it is their mean place. Of what is held from the first frame on it is their median until the
    hands move, as the record of the points shows it.
    """
    touched = min((hand.first for hand in seen.hands if hand.touches), default=episode.frames)
    moving = _moving(episode, seen.delay) if touched == 0 else touched
    still = episode.points[: max(moving, 1)]
    seen_mostly = np.isfinite(still).all(axis=2).mean(axis=0) >= 0.5
    middle = np.nanmedian if touched == 0 else np.nanmean
    return touched, np.asarray(middle(still[:, seen_mostly].astype(np.float64), axis=0))


def _moving(episode: Episode, delay: float) -> int:
    """The first frame in whose points hands are seen to have moved."""
    far = np.linalg.norm(episode.controllers - episode.controllers[0], axis=2).max(axis=1) > HELD_STILL_M
    begins = episode.times[int(np.argmax(far))] if far.any() else np.inf
    return int(np.searchsorted(episode.times, begins + delay))
