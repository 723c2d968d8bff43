"""How far around a hand an object comes along with it, measured by its tracks (docs/notes/grips.md)."""

from collections.abc import Sequence

import numpy as np

from egophys_core.geometry import rigid_fit
from egophys_core.kinds.kind import FIST_RADIUS
from egophys_core.observation.contact import Contact, Hand
from egophys_core.observation.observed import ObservedEpisode
from egophys_core.simulation import ContactKind

LEAST, MOST = 0.02, 0.06
"""Metres: of a fingertip's pinch, and of a palm. What comes along beyond that is stiff, and tells nothing."""

CORE, FEWEST = 8, 3
"""Tracks nearest to a hand, by which what is held moves, and how many of them must be seen to tell it."""

MOVED_AT_LEAST, KEPT = 0.02, 0.006
"""Metres that a hand must have moved for a frame to tell, and by which what comes along may be off at least."""

REST_FRAMES = 25
"""Most frames before a hold over which places are averaged."""


def grasp_radius(episodes: Sequence[ObservedEpisode]) -> float:
    """Metres from the middle of a hand within which the object moves with what it holds; the median over all holds.

    That of a fist where nothing tells.
    """
    found = [
        radius
        for each in episodes
        for hand in each.hands
        for contact in hand.contacts
        if contact.kind == ContactKind.HOLD and (radius := _of_hold(each, hand, contact)) is not None
    ]
    return float(np.median(found)) if found else FIST_RADIUS


def _of_hold(observed: ObservedEpisode, hand: Hand, contact: Contact) -> float | None:
    """Metres; None if too little is seen of it in the fitted frames, or all comes along."""
    episode, first = observed.episode, contact.first
    fingers = episode.controllers[:, hand.controllers].astype(np.float64)
    middle = fingers.mean(axis=1)
    before = episode.points[max(0, first - REST_FRAMES) : first + 1].astype(np.float64)
    tracks = np.flatnonzero(np.isfinite(before).all(axis=2).any(axis=0))
    rest = np.nanmean(before[:, tracks], axis=0)
    distance = np.linalg.norm(rest - middle[first], axis=1)
    order = np.argsort(distance, kind="stable")
    tracks, rest, distance = tracks[order], rest[order], distance[order]
    offsets = []
    for frame in range(first + 1, min(contact.last + 1, episode.train_frames)):
        if np.linalg.norm(middle[frame] - middle[first]) < MOVED_AT_LEAST:
            continue
        turn, _ = rigid_fit(fingers[first], fingers[frame])
        moved = episode.points[frame, tracks] - (rest - middle[first]) @ turn.T
        if np.isfinite(moved[:CORE]).all(axis=1).sum() >= FEWEST:
            # What is held moves as its nearest tracks do; the hand itself may be off by more than that.
            offsets.append(np.linalg.norm(moved - np.nanmedian(moved[:CORE], axis=0), axis=1))
    if not offsets:
        return None
    seen = np.isfinite(offsets).any(axis=0)
    off = np.nanmedian(np.array(offsets)[:, seen], axis=0)
    comes_along = off <= max(KEPT, 2.0 * float(np.median(off[:CORE])))
    # Where most that is nearer comes along, and most that is farther does not.
    last = int(np.argmax(np.cumsum(np.where(comes_along, 1, -1))))
    reaches = float(distance[seen][last])
    return max(reaches, LEAST) if reaches < MOST else None
