"""Paths of hands that hold, put right by what moves with them.

The outline of a hand tells its motion well from view to view, and its depth by a few per cent; a solid is known as a
whole to a few millimetres. All within about 45 mm of a fist moves with it as one piece (docs/notes/grips.md), so that
piece's rigid motion is that of the hand. For sheets the outline is better (docs/notes/hands.md).
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from egophys_core.geometry import rigid_fit

PIECE_M = 0.045
"""Metres around the place where a hand holds: what moves with it as one piece."""

FEWEST = 6
"""Points of that piece that must be seen."""

STIFF_M = 0.006
"""Metres: root mean square by which they may move otherwise than as one piece."""

FARTHEST_M = 0.08
"""Metres: what would move the hand farther from its outline than that is held by it no more."""

STEADY_S = 0.1
"""Seconds over which the correction of a path is averaged: it is one of its depth, which changes slowly."""


@dataclass(frozen=True, kw_only=True)
class HandPath:
    """A hand over T views."""

    places: np.ndarray
    """[T, 3] metres, frame world: where it holds or pushes."""
    turns: np.ndarray
    """[T, 3, 3]: how it is turned since it took hold; none before, and none of a hand that pushes."""


def unturned(places: np.ndarray) -> HandPath:
    """The path [T, 3], metres, of a hand of whose turning nothing is known."""
    return HandPath(places=places, turns=np.broadcast_to(np.eye(3), (len(places), 3, 3)))


def carried_path(
    places: np.ndarray, first: int, points: np.ndarray, is_seen: np.ndarray, times: np.ndarray
) -> HandPath:
    """The path of a hand that holds, which goes along with what it holds where that is seen.

    Args:
        places: [T, 3] metres: where it holds by its outline.
        first: view in which it has taken hold.
        points: [T, N, 3] metres.
        is_seen: [T, N] bool: points whose places are known.
        times: [T] seconds.
    """
    piece = is_seen[first] & (np.linalg.norm(points[first] - places[first], axis=1) <= PIECE_M)
    known, corrections, turns = [first], [np.zeros(3)], [np.eye(3)]
    for view in range(first + 1, len(places)):
        members = piece & is_seen[view]
        if np.count_nonzero(members) < FEWEST:
            continue
        before, now = points[first, members].astype(float), points[view, members].astype(float)
        turn, shift = rigid_fit(before, now)
        off = np.sqrt(((before @ turn.T + shift - now) ** 2).sum(axis=1).mean())
        correction = turn @ places[first] + shift - places[view]
        if off <= STIFF_M and np.linalg.norm(correction) <= FARTHEST_M:
            known.append(view)
            corrections.append(correction)
            turns.append(turn)
    if len(known) < 2:
        return unturned(places)
    held = np.clip(times, times[known[0]], times[known[-1]])
    step = float(np.median(np.diff(times)))
    along = np.column_stack([np.interp(held, times[known], each) for each in np.array(corrections).T])
    return HandPath(
        places=places + gaussian_filter1d(along, STEADY_S / step, axis=0, mode="nearest"),
        turns=Slerp(times[known], Rotation.from_matrix(np.array(turns)))(held).as_matrix(),
    )
