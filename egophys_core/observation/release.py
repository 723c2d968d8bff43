"""The moment at which the last hand lets go, which is between two frames: what drops is 8 cm lower after four.

A twin that is let go at the next frame falls up to 33 ms too late, which after a third of a second is 10 cm: more than
a gravity that is less by a fifth. So the moment is a frame of its own, in which nothing is seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.interpolation import values_at
from egophys_core.observation.contact import Contact, Hand
from egophys_core.observation.mean_path import mean_path, points_seen_mostly

WINDOW_S, FEWEST_FRAMES = 0.14, 4
"""Seconds, and frames at least, before and after it that tell when it was."""

TOGETHER_S = 0.1
"""Within which hands let go together, and within which of what was found the moment is looked for."""

FEWEST_POINTS = 5

FALLS_M_S2 = 1.0
"""An acceleration downwards below which nothing falls."""

RESIDUAL_SHARE = 0.05
"""Of how far it falls in the window, the residual of a fall at one acceleration at most (root mean square)."""

SEPARATE_S = 1e-3
"""From a frame, at least; what is nearer is in it."""

TRIED = 200
"""Moments."""


@dataclass(frozen=True, kw_only=True)
class Released:
    """An episode in which every moment is a frame from which on the object falls."""

    episode: Episode
    hands: tuple[Hand, ...]
    """With their contacts in its frames."""
    falls: tuple[int, ...]
    """These frames; nothing is seen in them where they are not of the record."""


def with_releases(episode: Episode, hands: Sequence[Hand], delay: float) -> Released:
    """The episode with a frame for each moment from which on the object falls.

    Args:
        delay: seconds by which the points are recorded later than the hands.
    """
    found, later = Released(episode=episode, hands=tuple(hands), falls=()), np.inf
    # From the last on, so that the frames of the others stay.
    for last in reversed(_let_go(found.hands, episode.frames)):
        moment = None if later - episode.times[last] <= TOGETHER_S + delay else _moment(episode, last, delay)
        if moment is not None:
            found, later = _with_moment(found, moment - delay), moment
    return found


def _let_go(hands: Sequence[Hand], frames: int) -> list[int]:
    """Frames after which no hand is in contact any more, though one was."""
    touched = np.zeros(frames + 1, bool)
    for hand in hands:
        for each in hand.contacts:
            touched[each.first : each.last + 1] = True
    return [int(frame) for frame in np.flatnonzero(touched[:-1] & ~touched[1:]) if frame + 1 < frames]


def _moment(episode: Episode, last: int, delay: float) -> float | None:
    """Seconds, in the record of the points, from which on what was held until about a frame falls; None if it does not.

    Until then the mean of its points rises or sinks evenly, and then it is accelerated evenly downwards. Hands that
    carry it along as they let go accelerate it aside, and more than gravity does: that tells nothing.
    """
    times = episode.times
    about = times[last] + delay
    middle = int(np.searchsorted(times, about, side="right")) - 1
    before = min(int(np.searchsorted(times, about - WINDOW_S)), middle - FEWEST_FRAMES)
    after = max(int(np.searchsorted(times, about + WINDOW_S, side="right")), middle + 2 + FEWEST_FRAMES)
    if before < 0 or after > episode.frames:
        return None
    window = slice(before, after)
    seen = points_seen_mostly(episode.points[window])
    if len(seen) < FEWEST_POINTS:
        return None
    heights = mean_path(episode.points[window][:, seen])[:, 2]
    known = np.isfinite(heights)
    since, heights = times[window][known], heights[known]
    tried = np.linspace(about - TOGETHER_S, about + TOGETHER_S, TRIED)
    fits = [_falling_from(moment, since, heights) for moment in tried]
    best = int(np.argmin([residual for _, residual in fits]))
    acceleration, residual = fits[best]
    fallen = 0.5 * acceleration * (since[-1] - tried[best]) ** 2
    return float(tried[best]) if acceleration >= FALLS_M_S2 and residual <= RESIDUAL_SHARE * fallen else None


def _falling_from(moment: float, times: np.ndarray, heights: np.ndarray) -> tuple[float, float]:
    """The acceleration downwards from a moment on that fits heights [T] best, and its residual, metres."""
    since = times - moment
    terms = np.stack([np.ones_like(since), since, 0.5 * np.maximum(since, 0.0) ** 2], axis=1)
    found, *_ = np.linalg.lstsq(terms, heights, rcond=None)
    return -float(found[2]), float(np.sqrt(np.mean((heights - terms @ found) ** 2)))


def _with_moment(found: Released, moment: float) -> Released:
    """With contacts that end at a moment, seconds, if they were found to end about then, and that as a frame."""
    times = found.episode.times
    nearest = int(np.argmin(np.abs(times - moment)))
    new = int(abs(times[nearest] - moment) >= SEPARATE_S)
    frame = int(np.searchsorted(times, moment)) if new else nearest

    def moved(each: Contact) -> Contact | None:
        if abs(times[each.last] - moment) <= TOGETHER_S:
            # What seems to be touched again as it begins to fall is not.
            return replace(each, last=frame - 1) if each.first < frame else None
        return replace(each, first=each.first + new, last=each.last + new) if each.first >= frame else each

    return Released(
        episode=_with_frame(found.episode, frame, moment) if new else found.episode,
        hands=tuple(
            replace(hand, contacts=tuple(each for each in map(moved, hand.contacts) if each is not None))
            for hand in found.hands
        ),
        falls=(frame, *(each + new for each in found.falls)),
    )


def _with_frame(episode: Episode, frame: int, time: float) -> Episode:
    """With a frame at a time, seconds, before one, in which nothing is seen and hands are between where they were."""
    between = values_at(episode.times, episode.controllers, time).astype(episode.controllers.dtype)
    contact = episode.contact
    return replace(
        episode,
        times=np.insert(episode.times, frame, time),
        points=np.insert(episode.points, frame, np.nan, axis=0),
        confidence=np.insert(episode.confidence, frame, 0.0, axis=0),
        controllers=np.insert(episode.controllers, frame, between, axis=0),
        contact=None if contact is None else np.insert(contact, frame, False, axis=0),
    )
