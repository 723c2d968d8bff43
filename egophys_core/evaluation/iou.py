"""Overlap of the silhouettes of a predicted and an observed surface, for point episodes without cameras.

The paper and PhysTwin render the twin into a camera and compare masks. A point episode has no camera, so here both
surfaces are looked at along the three world axes, from infinity:

- The picture is a grid of square cells, a quarter of a point spacing wide, with a corner at the origin. The point
  spacing is the median distance to the fourth-nearest point over the points seen in frame 0 (the pitch of a grid).
- A point fills its cell and those whose centres are at most four cells (one point spacing) from the centre of its own.
- IoU of a view: cells filled in both pictures over cells filled in either. IoU of a frame: mean over the three views.

Only what was seen is compared: in each frame the visible tracks with the vertices they are bound to (as for the track
error). Parts hidden in a frame are missing in both pictures, so a perfect prediction has 1 however much is hidden.
Motion along the surface does not count as long as the silhouettes stay; for that there is the track error. A silhouette
is one point spacing wider than the object on all sides, so the IoU of thin parts is lenient. Noise costs a little:
between frames of the shipped towel at rest (1.5 mm of noise, points 16 mm apart) the IoU is 0.94.
"""

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.evaluation.metrics import visible_pairs

SPACING_NEIGHBOUR = 4
"""Inside a square grid the fourth-nearest point is one pitch away."""

REACH = 4
"""Cells: radius of the disc a point fills; a cell is the point spacing over this.

With 2 the IoU of a flat sheet and itself with 1.5 mm of noise depends on where it lies in the grid (0.86 +- 0.05, 20 mm
spacing), with 4 hardly (0.877 +- 0.007).
"""

VIEWS = ([0, 1], [0, 2], [1, 2])
"""Axes of the picture seen along z, y and x."""

FARTHEST_CELL = 2**30
"""Cells farther out count as this far, so that two cell numbers fit into 64 bits."""

_across = np.arange(-REACH, REACH + 1)
_disc = np.stack(np.meshgrid(_across, _across), axis=-1).reshape(-1, 2)
DISC = _disc[(_disc**2).sum(axis=1) <= REACH**2]
"""[49, 2] int: the cells a point fills, from its own."""


def iou_per_frame(predicted: np.ndarray, points: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """[T] in 0..1: IoU of the silhouettes; NaN without visible bound tracks, or if frame 0 has but one.

    Args:
        predicted: [T, V, 3] metres, finite.
        points: [T, N, 3] metres, NaN where unseen.
        bound: [N] from `bind_tracks`.
    """
    overlap = np.full(len(points), np.nan)
    cell = point_spacing(points[0]) / REACH
    if not cell > 0:
        return overlap
    for frame, (vertices, observed) in enumerate(visible_pairs(predicted, points, bound)):
        if len(observed):
            overlap[frame] = np.mean([_view_iou(vertices[:, axes] / cell, observed[:, axes] / cell) for axes in VIEWS])
    return overlap


def point_spacing(points: np.ndarray) -> float:
    """Metres: median distance of the visible points of [N, 3] to their fourth-nearest other; NaN for fewer than 2."""
    seen = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    if len(seen) < 2:
        return float("nan")
    rank = min(SPACING_NEIGHBOUR, len(seen) - 1) + 1
    return float(np.median(cKDTree(seen).query(seen, k=[rank])[0]))


def _view_iou(one: np.ndarray, other: np.ndarray) -> float:
    """IoU of the cells filled by points [A, 2] and [B, 2], in units of cells."""
    first, second = _filled(one), _filled(other)
    both = len(np.intersect1d(first, second, assume_unique=True))
    return both / (len(first) + len(second) - both)


def _filled(points: np.ndarray) -> np.ndarray:
    """Numbers of the filled cells, each once."""
    own = np.clip(np.floor(points), -FARTHEST_CELL, FARTHEST_CELL).astype(np.int64)
    own = own[:, 0] * 2**32 + own[:, 1]
    return np.unique(np.unique(own)[:, None] + (DISC[:, 0] * 2**32 + DISC[:, 1]))
