"""Clamps: held points that move as one piece, and what they carry along."""

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.geometry import rigid_fit

GAP = 0.15
"""Metres within which held points may belong to one clamp."""

RIGID = 0.01
"""Metres by which the distance between two points of one clamp changes at most."""

STILL = 0.002
"""Metres: held points that never move farther belong to a clamp that stands still; markers slip in their glue."""

SMOOTHED_S = 0.08
"""Seconds around a frame that tell where held points are in it: hands do not shake faster."""


def clamp_groups(held: np.ndarray) -> list[np.ndarray]:
    """Indices of the held points [T, C, 3] of each clamp."""
    label = np.full(held.shape[1], -1)
    for seed in range(held.shape[1]):
        if label[seed] < 0:
            distances = np.linalg.norm(held - held[:, seed : seed + 1], axis=2)
            one_piece = (distances[0] < GAP) & (np.ptp(distances, axis=0) < RIGID)
            label[one_piece & (label < 0)] = label.max() + 1
    return [np.flatnonzero(label == clamp) for clamp in range(label.max() + 1)]


def stands_still(held: np.ndarray, *, within: float = STILL) -> bool:
    """Whether held points [T, C, 3] stay within so many metres of where they are in frame 0."""
    return bool(np.linalg.norm(held - held[0], axis=2).max(initial=0.0) < within)


def smoothed_clamps(held: np.ndarray, times: np.ndarray) -> np.ndarray:
    """[T, C, 3] metres: held points by parabolas through the frames (s) around each, where these are dense enough.

    Two held points 20 mm apart, each off by 0.2 mm, say a clamp's direction to no more than 10 mrad, frame by frame.
    """
    frames = 2 * round(0.5 * SMOOTHED_S / float(np.median(np.diff(times)))) + 1
    if not 5 <= frames <= len(times):
        return held
    # A second of imports, which only records of markers need.
    from scipy.signal import savgol_filter

    return np.asarray(savgol_filter(held, frames, 2, axis=0))


def carried_by_clamps(held: np.ndarray, clamped: np.ndarray, *, still: float = STILL) -> np.ndarray:
    """[T, G, 3] metres: clamped points [G, 3] of frame 0, moved by the held points [T, C, 3] of the nearest clamp.

    Two held points do not tell how a clamp turns about their line: it does not.

    Args:
        still: metres within which held points do not move.
    """
    groups = clamp_groups(held)
    centres = np.array([held[0, members].mean(axis=0) for members in groups])
    owner = cKDTree(centres).query(clamped)[1]
    carried = np.repeat(clamped[None], len(held), axis=0)
    for clamp, members in enumerate(groups):
        track, mine = held[:, members], owner == clamp
        if not mine.any() or stands_still(track, within=still):
            continue
        for frame, now in enumerate(track):
            turn, shift = rigid_fit(track[0], now)
            carried[frame, mine] = clamped[mine] @ turn.T + shift
    return carried
