"""Rotations about an axis (Rodrigues' formula)."""

import numpy as np


def rotation(vector: np.ndarray) -> np.ndarray:
    """[3, 3] rotation about a vector [3] by its length, rad; exactly the identity for no rotation."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
