"""How the visible side of a solid rounds off towards its outline, where patches show half the background.

Along the rays of one view, an ellipsoid has the inverse depths w = plane + sqrt(g), both of the pixel: a plane, and a
quadratic g that is 0 on the outline, where the rays graze the body. With its scale left open, g solves
Laplace(g) = -1 inside the outline (Prandtl's torsion function); so it is defined for outlines of any shape.
"""

import cv2
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from egophys_core.perception.robust import cauchy_weights, robust_scale

ITERATIONS = 10


def rounded(mask: np.ndarray, pixels: np.ndarray, inverse: np.ndarray, sure: np.ndarray) -> np.ndarray:
    """[V]: inverse depths, 1/m, of the rounded shape that is nearest to the sure ones, robustly.

    Args:
        mask: [H, W] bool, of the object.
        pixels: [V, 2], x and y of vertices in the mask.
        inverse: [V] 1/m.
        sure: [V] bool: those that count.
    """
    x, y = pixels.astype(np.float32).T
    height = cv2.remap(torsion(mask).astype(np.float32), x, y, cv2.INTER_LINEAR).ravel()
    columns = np.column_stack([np.ones(len(x)), x - x.mean(), y - y.mean(), np.sqrt(height)])
    weight = sure.astype(float)
    for _ in range(ITERATIONS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(root[:, None] * columns, root * inverse, rcond=None)[0]
        apart = columns @ found - inverse
        scale = max(float(robust_scale(apart[sure])), 1e-6)
        weight = np.where(sure, cauchy_weights(apart**2, 2 * scale), 0.0)
    # A hollow is not rounded; it stays a plane.
    found[3] = max(found[3], 0.0)
    return np.asarray(columns @ found)


def torsion(mask: np.ndarray) -> np.ndarray:
    """[H, W] square pixels: what has the Laplacian -1 in a mask and is 0 outside of it."""
    inside = mask.ravel()
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(np.count_nonzero(inside))
    pairs = [
        np.column_stack([one.ravel(), other.ravel()])
        for one, other in ((number[:, 1:], number[:, :-1]), (number[1:], number[:-1]))
    ]
    both = np.vstack(pairs)
    both = both[(both >= 0).all(axis=1)]
    count = np.count_nonzero(inside)
    beside = sparse.csr_matrix((np.ones(len(both)), both.T), shape=(count, count))
    laplacian = 4 * sparse.identity(count, format="csc") - beside - beside.T
    found = np.zeros(mask.shape)
    if count:
        found[mask] = spsolve(laplacian.tocsc(), np.ones(count))
    return found
