"""Paths of hands that push, put right by the table along which they move.

What lies on a table is pushed along it: 8 hands whose paths were measured change their height by 0 to 10 mm while they
push (docs/notes/pushes.md). The place in the view is right to a few pixels, so the height tells the depth better than
the width does, which drifts by some per cent as a hand turns.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d

WIDTH_DRIFT = 0.05
"""Standard deviation of the depth by the width of a hand that turns, over the depth."""

LEVEL_M = 0.008
"""Metres: standard deviation of the height. A hand that leaves the table does so far beyond that."""

FARTHEST = 0.2
"""Share of the depth by which it is put right at most."""

SHARES = np.linspace(1 - FARTHEST, 1 + FARTHEST, 201)

STEADY_VIEWS = 1.5
"""Views over which the correction is averaged."""


def level_path(places: np.ndarray, eyes: np.ndarray, height: float) -> np.ndarray:
    """[T, 3] metres: the path of a hand that pushes, nearer to or farther from the eye than by its width.

    Args:
        places: [T, 3] metres: where it pushes by its width.
        eyes: [T, 3] metres: where the camera is.
        height: metres: where it began to push.
    """
    sights = places - eyes
    heights = eyes[:, 2:] + SHARES * sights[:, 2:]
    # The height may be another one all at once, the width may not.
    misses = ((SHARES - 1) / WIDTH_DRIFT) ** 2 + np.log1p(((heights - height) / LEVEL_M) ** 2)
    shares = gaussian_filter1d(SHARES[misses.argmin(axis=1)], STEADY_VIEWS, mode="nearest")
    return np.asarray(eyes + shares[:, None] * sights)
