"""Where all of an object is of which a part is seen.

The mean of what is seen is not its middle: a sheet that opens or folds hides some of itself, and what is seen of a
solid that turns goes round the rest. So what is hidden of a sheet is taken to lie on the thin-plate spline over it at
rest through what is seen (Duchon, 1977), and a solid to turn as a whole.
"""

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from egophys_core.geometry import rigid_fit

FARTHEST = 0.35
"""Of the length of the sheet, from a node to the nearest track that is seen at most: farther, a spline makes the shape
up."""

FEWEST_OF_SHEET, FEWEST_OF_SOLID = 12, 6
"""Tracks that are seen at a time, to tell from them where the rest is."""

SMOOTHING = 1e-4
"""Of the spline, in lengths of the sheet: what two tracks of one place differ by is noise."""


def seen_sheet(nodes: np.ndarray, rest: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """[F, N, 3] metres, where the nodes of a sheet are in F frames; NaN in frames where too little of it is seen.

    Args:
        nodes: [N, 3] metres, at rest.
        rest: [P, 3] metres, tracks at rest, in the same frame.
        positions: [F, P, 3] metres, where they are seen; NaN where not.
    """
    centre = nodes.mean(axis=0)
    axes = np.linalg.svd(nodes - centre, full_matrices=False)[2]
    length = float(np.ptp((nodes - centre) @ axes[0]))
    everywhere, known = ((each - centre) @ axes[:2].T / length for each in (nodes, rest))
    places = np.full((len(positions), *nodes.shape), np.nan)
    for frame, tracks in zip(places, positions.astype(np.float64), strict=True):
        seen = np.isfinite(tracks).all(axis=1)
        if seen.sum() >= FEWEST_OF_SHEET and cKDTree(known[seen]).query(everywhere)[0].max() <= FARTHEST:
            try:
                frame[:] = RBFInterpolator(known[seen], tracks[seen], smoothing=SMOOTHING, degree=1)(everywhere)
            except np.linalg.LinAlgError:
                # Tracks on one line, as of a ribbon, do not tell how it lies across.
                continue
    return places


def seen_solid(nodes: np.ndarray, rest: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """[F, N, 3] metres, where the nodes of a solid are in F frames; NaN in frames in which few tracks are seen.

    Args:
        nodes: [N, 3] metres, at rest.
        rest: [P, 3] metres, tracks at rest, in the same frame.
        positions: [F, P, 3] metres, where they are seen; NaN where not.
    """
    places = np.full((len(positions), *nodes.shape), np.nan)
    for frame, tracks in zip(places, positions.astype(np.float64), strict=True):
        seen = np.isfinite(tracks).all(axis=1)
        if seen.sum() >= FEWEST_OF_SOLID:
            turn, shift = rigid_fit(rest[seen], tracks[seen])
            frame[:] = nodes @ turn.T + shift
    return places


def normal_products(places: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """[..., 3, 3] the mean of n n^T over triangles [F, 3] of nodes at [..., N, 3], n their normals of length 1.

    1 along a direction that all of a sheet faces, 0 along those that lie in it.
    """
    corners = places[..., faces, :]
    normals = np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    return np.asarray(np.swapaxes(normals, -1, -2) @ normals / max(len(faces), 1))
