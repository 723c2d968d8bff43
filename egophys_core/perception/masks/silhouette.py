"""What the outline of the object in the image says of the shape, where no texture is found."""

import cv2
import numpy as np
from scipy.spatial import cKDTree

from egophys_core.perception.stages import Masks

OUTSIDE_PX = 1.5
"""Pixels beyond the object at which a vertex is wrong; masks are good to about one."""

UNCOVERED_STEP = 4
"""Pixels between the places that the surface should cover."""

REACH_PX = 25.0
"""Pixels: no vertex is drawn farther than this to a place that is not covered."""


def outliers(vertices: np.ndarray, masks: Masks) -> tuple[np.ndarray, np.ndarray]:
    """Vertices seen where neither object nor hand is, which hides it, and the nearest place where they may be.

    Args:
        vertices: [V, 2] pixels.
        masks: of the view.

    Returns:
        [K] int indices of vertices, and [K, 2] pixels.
    """
    allowed = masks.object | masks.hand
    # With no object in sight the hand hides it, wherever it is: its outline says nothing.
    if not masks.object.any():
        return np.zeros(0, int), np.zeros((0, 2))
    distance, labels = cv2.distanceTransformWithLabels(
        (~allowed).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    rows, columns = np.nonzero(allowed)
    nearest = np.zeros((labels.max() + 1, 2))
    nearest[labels[rows, columns]] = np.column_stack([columns, rows])
    x, y = inside(vertices, allowed.shape).T
    outside = np.flatnonzero(distance[y, x] > OUTSIDE_PX)
    return outside, nearest[labels[y[outside], x[outside]]]


def uncovered(vertices: np.ndarray, covered: np.ndarray, masks: Masks) -> tuple[np.ndarray, np.ndarray]:
    """Places of the object that the surface does not cover, and the vertex nearest to each.

    Args:
        vertices: [V, 2] pixels.
        covered: [S, S] bool: the silhouette of the surface.
        masks: of the view.

    Returns:
        [K] int indices of vertices, and [K, 2] pixels.
    """
    widened = cv2.dilate(covered.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    rows, columns = np.nonzero(masks.object & ~widened)
    on_grid = (rows % UNCOVERED_STEP == 0) & (columns % UNCOVERED_STEP == 0)
    places = np.column_stack([columns[on_grid], rows[on_grid]]).astype(float)
    if not len(places):
        return np.zeros(0, int), places
    distance, nearest = cKDTree(vertices).query(places, distance_upper_bound=REACH_PX)
    near = np.isfinite(distance)
    return nearest[near], places[near]


def inside(pixels: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """[N, 2] int: nearest pixels x, y that lie in an image of height and width."""
    return np.clip(np.rint(np.nan_to_num(pixels)).astype(int), 0, [size[1] - 1, size[0] - 1])
