"""Paths of hands that hold a sheet, put right where the sheet would not reach that far.

No point of a sheet is farther from the hand that holds it than it was when the sheet lay flat. Of 60 hands whose paths
were measured, 54 pass that by at most 10 mm, the others, whose cloth stretches, by up to 35 (docs/notes/hands.md).
"""

import numpy as np

BEYOND_M = 0.04
"""Metres past that: no cloth gives so much, so the width of the hand is wrong."""

FEWEST, NEAREST = 10, 40
"""Points that must be seen, and how many are looked at: the nearest, since a slack sheet binds by those alone."""

FARTHEST_SHARE = 0.9
"""Of these, by whose excess a hand is judged: some are wrong."""


def path_within_reach(
    places: np.ndarray, eyes: np.ndarray, first: int, points: np.ndarray, is_sure: np.ndarray
) -> np.ndarray:
    """[T, 3] metres: the path of a hand; where it is beyond reach it is as far from the eye as before and after.

    Args:
        places: [T, 3] metres: where it holds by its width.
        eyes: [T, 3] metres: where the camera is.
        first: view in which it has taken hold.
        points: [T, N, 3] metres, of a sheet that lies flat in the first view.
        is_sure: [T, N] bool.
    """
    lengths = np.linalg.norm(points[0, :, :2] - places[first, :2], axis=1)
    near = np.argsort(np.where(is_sure[0], lengths, np.inf))
    is_within = np.ones(len(places), bool)
    for view in range(first + 1, len(places)):
        looked = near[is_sure[0, near] & is_sure[view, near]][:NEAREST]
        if len(looked) >= FEWEST:
            past = np.linalg.norm(points[view, looked] - places[view], axis=1) - lengths[looked]
            is_within[view] = np.quantile(past, FARTHEST_SHARE) < BEYOND_M
    sights = places - eyes
    away = np.linalg.norm(sights, axis=1)
    views = np.arange(len(places))
    found = np.interp(views, views[is_within], away[is_within])
    return np.asarray(eyes + (found / away)[:, None] * sights)
