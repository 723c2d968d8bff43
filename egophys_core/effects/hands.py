"""What effects of grip and tracking need to know of the hands: which points are one hand, and how it turns."""

import numpy as np

HAND_SIZE = 0.15
"""Metres: controller points nearer to each other than this are taken for one hand."""

LEAST_WIDTH = 0.003
"""Metres: points of a hand that spread less than this across their line say nothing of how it turns."""


FRAMES_APART = 10
"""Frames between those in which points are compared to tell which belong to one hand."""


def hands_of(controllers: np.ndarray) -> np.ndarray:
    """[C] the number of the hand that each of the controller points [F, C, 3], metres, belongs to."""
    apart = controllers[::FRAMES_APART]
    together = (np.linalg.norm(apart[:, :, None] - apart[:, None], axis=3) < HAND_SIZE).all(axis=0)
    return np.asarray(np.unique(together, axis=0, return_inverse=True)[1]).reshape(-1)


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
