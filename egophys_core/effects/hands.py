"""What effects of grip and tracking need to know of the hands: which points are one hand, and how it turns."""

import numpy as np

HAND_SIZE = 0.15
"""Metres: controller points nearer to each other than this are taken for one hand."""

LEAST_WIDTH = 0.003
"""Metres: points of a hand that spread less than this across their line say nothing of how it turns."""


def turns(points: np.ndarray) -> np.ndarray:
    """[F, 3, 3] rotations of points [F, P, 3] from the first frame to each, by least squares (Kabsch, 1976).

    No rotation where the points lie on a line.
    """
    centred = points - points.mean(axis=1, keepdims=True)
    spreads = np.linalg.svd(centred[0], compute_uv=False)
    if len(spreads) < 2 or spreads[1] < LEAST_WIDTH:
        return np.tile(np.eye(3), (len(points), 1, 1))
    left, _, right = np.linalg.svd(np.einsum("pi,fpj->fij", centred[0], centred))
    # A reflection would fit flat hands as well.
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return np.swapaxes(left @ right, 1, 2)
