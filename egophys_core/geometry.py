"""Geometry that several rooms need."""

import numpy as np
from scipy.spatial.transform import Rotation


def least_rotation(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """[3, 3] the least rotation that turns one direction [3] into another; none if either has no length."""
    lengths = np.linalg.norm(source) * np.linalg.norm(target)
    if lengths < 1e-12:
        return np.eye(3)
    axis = np.cross(source, target) / lengths
    sine, cosine = float(np.linalg.norm(axis)), float(source @ target / lengths)
    if sine < 1e-9:
        # Directions that are opposite have no least rotation; about which axis does not matter.
        return np.eye(3) if cosine > 0.0 else 2.0 * np.outer(side := _aside(source), side) - np.eye(3)
    return np.asarray(Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)).as_matrix())


def rigid_fit(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation [3, 3] and shift [3] that bring points [P, 3] nearest to others (Kabsch, Acta Cryst. A32 (1976) 922).

    Of all rotations that bring them as near it is the least: none for one point, none about the line of two.
    """
    middle, aim = source.mean(axis=0), target.mean(axis=0)
    if len(source) < 3:
        turn = least_rotation(source[-1] - source[0], target[-1] - target[0])
        return turn, aim - turn @ middle
    left, _, right = np.linalg.svd((source - middle).T @ (target - aim))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    turn = (left @ mirror @ right).T
    return turn, aim - turn @ middle


def _aside(direction: np.ndarray) -> np.ndarray:
    """[3] a unit vector across a direction [3]."""
    across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    return np.asarray(across / np.linalg.norm(across))
