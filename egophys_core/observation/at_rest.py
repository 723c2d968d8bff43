"""The object before any hand moves it."""

from dataclasses import replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.interpolation import values_at
from egophys_core.observation.contact import SeenHands

HELD_STILL_M, HELD_STILL_S = 0.005, 1.0
"""Metres: hands that hold from the first frame on and have moved no farther have not moved the object yet; and seconds
for which that is believed: it may swing under hands that stand."""

NEAR_M = 0.1
"""Metres from a hand that holds within which tracks keep their distance to it, more or less."""

AGREES_M = 0.004
"""Metres by which frames that show the object in one way differ. Cameras that fit a mesh to a cloth anew in each frame
shift all of it by a cell now and then."""


def first_touch(episode: Episode, seen: SeenHands) -> int:
    """Frame of the first contact; the number of frames where there is none."""
    return min((hand.first for hand in seen.hands if hand.touches), default=episode.frames)


def still_frames(episode: Episode, seen: SeenHands) -> int:
    """Frames, at least 1, before hands move the object: before they take hold, or, of what they hold from the first
    frame on, before they are seen to move in the record of the points."""
    touched = first_touch(episode, seen)
    return max(_moving(episode, seen.delay) if touched == 0 else touched, 1)


def observed_at_rest(episode: Episode, still: int) -> np.ndarray:
    """[P, 3] metres: mean places of the points that are seen mostly in the first frames, which are still."""
    points = episode.points[:still]
    seen_mostly = np.isfinite(points).all(axis=2).mean(axis=0) >= 0.5
    return np.asarray(np.nanmean(points[:, seen_mostly].astype(np.float64), axis=0))


def from_rest(episode: Episode, still: int, delay: float) -> Episode:
    """The episode of what is held from the first of its still frames on that shows it as the whole record does; places
    in it are the medians of all still frames that do.

    Tracks are told by where they are in the first frame, so that must not be a wrong one.

    Args:
        still: frames before hands move it.
        delay: seconds by which points are recorded later than hands.
    """
    off = _unusual(episode, delay)[:still]
    usual = np.flatnonzero(off <= np.nanmin(off, initial=np.inf) + AGREES_M)
    first = int(usual[0]) if len(usual) else 0
    shown = episode.from_frame(first)
    points = shown.points.copy()
    if len(usual):
        seen = np.isfinite(points[0]).all(axis=1)
        points[0][seen] = np.nanmedian(episode.points[np.ix_(usual, seen)], axis=0)
    return replace(shown, points=points)


def _unusual(episode: Episode, delay: float) -> np.ndarray:
    """[T] metres: by how much distances of near tracks from the hands are not those of the whole record (medians); NaN
    where none of these is seen."""
    hands = values_at(episode.times, episode.controllers, episode.times - delay)
    points = episode.points[:, episode.visible.any(axis=0)]
    away = np.linalg.norm(points[:, :, None] - hands[:, None], axis=3)
    usual = np.nanmedian(away, axis=0)
    near = usual < NEAR_M
    if not near.any():
        return np.zeros(episode.frames)
    off = np.abs(away - usual)[:, near]
    found, shown = np.full(episode.frames, np.nan), np.isfinite(off).any(axis=1)
    found[shown] = np.nanmedian(off[shown], axis=1)
    return found


def _moving(episode: Episode, delay: float) -> int:
    """The first frame in whose points hands are seen to have moved."""
    far = np.linalg.norm(episode.controllers - episode.controllers[0], axis=2).max(axis=1) > HELD_STILL_M
    begins = episode.times[int(np.argmax(far))] + delay if far.any() else np.inf
    return int(np.searchsorted(episode.times, min(begins, HELD_STILL_S)))
