"""When each hand holds the object, found from its distance to the observed points."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.episode import Episode

HAND_GAP = 0.15
"""Metres: controller points that never come this near to each other belong to different hands."""

NEAR = 0.05
"""Metres: a hand whose mean distance to the object stays above this has no contact."""

SETTLED = 0.004
"""Metres: a hand holds while it is at most this much farther from the object than during most of the hold.

A few times the noise of one point (1.5 mm); nearest distances average over the hand's points.
"""

GRASPED_REACH = 0.04
"""Metres: object points this near to a hand's centre tell whether the object moves with it."""

STILL_SPEED = 0.04
"""m/s: a hand holds once it moves this little against those points; before, it is still reaching.

Their mean velocity over two frames at 30 Hz has a noise of about 0.01 m/s.
"""


@dataclass(frozen=True, kw_only=True)
class Hand:
    """Controller points that move together, and the frames in which they hold the object."""

    controllers: np.ndarray
    """[H] int, indices into the episode's controllers."""
    first: int
    """First frame of the hold."""
    last: int
    """Last frame of the hold; first > last if this hand never holds."""

    @property
    def holds(self) -> bool:
        """Whether there is a hold at all."""
        return self.first <= self.last


def find_hands(episode: Episode) -> list[Hand]:
    """The hands of an episode and when each holds the object, in order of their first controller."""
    return [_find_hold(episode, members) for members in _group(episode.controllers)]


def hold_flags(episode: Episode, hands: Sequence[Hand]) -> np.ndarray:
    """[T, C] bool: where a controller point holds the object."""
    hold = np.zeros(episode.controllers.shape[:2], bool)
    for hand in hands:
        hold[hand.first : hand.last + 1, hand.controllers] = True
    return hold


def _group(controllers: np.ndarray) -> list[np.ndarray]:
    """Split [T, C, 3] controllers into hands: points of one hand stay near each other all the time."""
    count = controllers.shape[1]
    widest = np.zeros((count, count))
    for points in controllers[:: max(1, len(controllers) // 50)]:
        widest = np.maximum(widest, np.linalg.norm(points[:, None] - points[None], axis=2))
    label = np.full(count, -1)
    for seed in range(count):
        if label[seed] < 0:
            label[(label < 0) & (widest[seed] < HAND_GAP)] = label.max() + 1
    return [np.flatnonzero(label == hand) for hand in range(label.max() + 1)]


def _find_hold(episode: Episode, members: np.ndarray) -> Hand:
    distance = np.full(episode.frames, np.inf)
    # A point that the hand hides counts where it was last seen: hiding it does not take it away.
    points = np.full_like(episode.points[0], np.nan)
    for frame, controllers in enumerate(episode.controllers[:, members]):
        points = np.where(np.isfinite(episode.points[frame]), episode.points[frame], points)
        known = points[np.isfinite(points).all(axis=1)]
        distance[frame] = cKDTree(known).query(controllers)[0].mean()
    near = distance < NEAR
    if not near.any():
        return Hand(controllers=members, first=0, last=-1)
    settled = np.flatnonzero(distance < np.median(distance[near]) + SETTLED)
    first = next((frame for frame in settled if _relative_speed(episode, members, frame) < STILL_SPEED), settled[0])
    return Hand(controllers=members, first=int(first), last=int(settled[-1]))


def _relative_speed(episode: Episode, members: np.ndarray, frame: int) -> float:
    """m/s: speed of a hand against the object points near it, from the frames before and after.

    Without such points in both frames (the hand hides them) the object counts as being at rest.
    """
    before, after = max(frame - 1, 0), min(frame + 1, episode.frames - 1)
    duration = episode.times[after] - episode.times[before]
    hand = episode.controllers[:, members].mean(axis=1)
    points = episode.points[[before, after]]
    gap = np.linalg.norm(points - hand[[before, after], None], axis=2).max(axis=0)
    near = gap < GRASPED_REACH
    moved = np.diff(points[:, near], axis=0)[0].mean(axis=0) if near.any() else np.zeros(3)
    return float(np.linalg.norm(hand[after] - hand[before] - moved) / duration)
