"""What a hand holds goes along with it: places of points that it hides while it holds them."""

from collections.abc import Mapping

import numpy as np

HELD_RADIUS_M = 0.025
"""Metres around the grip: what is held; about a finger and a thumb."""

FEWEST = 3
"""Points that are held at least, wherever the hand takes hold."""

ASTRAY_M = 0.03
"""Metres: a held point that is seen farther from where it should be was let go."""


def held_points(
    points: np.ndarray, is_seen: np.ndarray, paths: Mapping[int, np.ndarray], holds: Mapping[int, int]
) -> np.ndarray:
    """[T, N, 3] metres: where points are that a hand hides and holds; NaN elsewhere.

    Points that are seen near a held one tell when it is let go.

    Args:
        points: [T, N, 3] metres, as tracked; where they are not seen they are guesses.
        is_seen: [T, N] bool.
        paths: [T, 3] metres, by the hand's number: where it holds.
        holds: first view of the hold, by the hand's number.
    """
    held = np.full(points.shape, np.nan)
    for number, first in holds.items():
        path = paths[number]
        away = np.linalg.norm(points[first] - path[first], axis=1)
        reach = max(HELD_RADIUS_M, float(np.sort(away)[:FEWEST].max()))
        members = np.flatnonzero(away <= reach)
        places = points[first, members] + (path[first:, None] - path[first])
        seen = is_seen[first:, members]
        lost = seen & (np.linalg.norm(points[first:, members] - places, axis=2) > ASTRAY_M)
        end = int(np.argmax(lost.any(axis=1))) if lost.any() else len(places)
        hidden = ~seen[:end]
        held[first : first + end, members] = np.where(hidden[..., None], places[:end], np.nan)
    return held
