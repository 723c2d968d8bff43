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


def _aside(direction: np.ndarray) -> np.ndarray:
    """[3] a unit vector across a direction [3]."""
    across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    return np.asarray(across / np.linalg.norm(across))
