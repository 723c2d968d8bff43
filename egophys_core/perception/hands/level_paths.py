"""Paths of hands put right by their height: of those that push or draw along the table, and of any under the table.

What lies on a table is pushed along it: 8 hands whose paths were measured change their height by 0 to 10 mm while they
push (docs/notes/pushes.md). The place in the view is right to a few pixels, so the height tells the depth better than
the width does, which drifts by some per cent as a hand turns.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d

PUSHING_DRIFT, HOLDING_DRIFT = 0.05, 0.03
"""Standard deviation of the depth by the width of a hand, over the depth: a palm that pushes turns, a fist hardly."""

LEVEL_M = 0.008
"""Metres: standard deviation of the height. A hand that leaves the table does so far beyond that."""

FARTHEST = 0.2
"""Share of the depth by which it is put right at most."""

SHARES = np.linspace(1 - FARTHEST, 1 + FARTHEST, 201)

STEADY_VIEWS = 1.5
"""Views over which the correction is averaged."""

AROUND_M = 0.12
"""Metres from a hand, level: what is seen there of a sheet lies on the table where the hand draws it."""

LYING_M = 0.02
"""Metres above the table up to which a sheet lies on it."""

TAKEN_M = 0.04
"""Metres above the table up to which a hand takes hold of what lies on it."""

FEWEST, MOST_LIE, MOST_OF_TIME = 10, 0.75, 0.5
"""Points around a hand that are seen, their share that lies, and the share of the time in which it does."""


def level_path(places: np.ndarray, eyes: np.ndarray, height: float, drift: float) -> np.ndarray:
    """[T, 3] metres: the path of a hand along the table, nearer to or farther from the eye than by its width.

    Args:
        places: [T, 3] metres: where it acts by its width.
        eyes: [T, 3] metres: where the camera is.
        height: metres: where it began to.
        drift: of its width.
    """
    sights = places - eyes
    heights = eyes[:, 2:] + SHARES * sights[:, 2:]
    # The height may be another one all at once, the width may not.
    misses = ((SHARES - 1) / drift) ** 2 + np.log1p(((heights - height) / LEVEL_M) ** 2)
    shares = gaussian_filter1d(SHARES[misses.argmin(axis=1)], STEADY_VIEWS, mode="nearest")
    return np.asarray(eyes + shares[:, None] * sights)


def above_table(places: np.ndarray, eyes: np.ndarray, ground: float) -> np.ndarray:
    """[T, 3] metres: the path of a hand, nearer to the eye where it would be under the table.

    Args:
        places: [T, 3] metres: where it is by its width.
        eyes: [T, 3] metres: where the camera is, above the table.
        ground: metres: height of the table.
    """
    shares = (eyes[:, 2] - ground) / (eyes[:, 2] - np.minimum(places[:, 2], ground))
    return np.asarray(eyes + shares[:, None] * (places - eyes))


def drawn_path(
    places: np.ndarray, eyes: np.ndarray, first: int, points: np.ndarray, is_sure: np.ndarray, ground: float
) -> np.ndarray:
    """[T, 3] metres: the path of a hand that holds a sheet; level while it draws that along the table.

    Args:
        places: [T, 3] metres: where it holds by its width.
        eyes: [T, 3] metres: where the camera is.
        first: view in which it has taken hold.
        points: [T, N, 3] metres, of the sheet.
        is_sure: [T, N] bool.
        ground: metres: height of the table.
    """
    lies = np.zeros(len(places), bool)
    for view in range(first, len(places)):
        away = np.linalg.norm(points[view, :, :2] - places[view, :2], axis=1)
        heights = points[view, is_sure[view] & (away < AROUND_M), 2]
        lies[view] = len(heights) >= FEWEST and np.quantile(heights, MOST_LIE) < ground + LYING_M
    if lies[first:].mean() < MOST_OF_TIME or places[first, 2] > ground + TAKEN_M:
        return places
    return np.where(lies[:, None], level_path(places, eyes, float(places[first, 2]), HOLDING_DRIFT), places)
