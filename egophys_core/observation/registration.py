"""Placing a twin's rest shape where an episode shows the object before contact."""

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.geometry import turn_about_vertical

YAW_STARTS = 8
"""Rotations about the vertical tried from scratch when the shape is not already in place."""

ITERATIONS = 30


def place(positions: np.ndarray, observed: np.ndarray, *, spacing: float) -> np.ndarray:
    """How to turn about the vertical and shift a shape onto observed points (iterative closest point).

    A shape on which 90 % of the observed points lie to a quarter of its spacing is left as it is, to the bit.

    Args:
        positions: [N, 3] float32 metres, surface nodes of the twin at rest.
        observed: [P, 3] metres, the object before contact.
        spacing: metres between nodes.

    Returns:
        [4] x, y, z shift in metres after a turn about the centroid of `positions`, and that turn in radians.
    """
    if np.quantile(cKDTree(positions).query(observed)[0], 0.9) < 0.25 * spacing:
        return np.zeros(4)
    starts = np.arange(YAW_STARTS) * 2 * np.pi / YAW_STARTS
    results = [_align(positions.astype(np.float64), observed.astype(np.float64), yaw) for yaw in starts]
    return min(results, key=lambda result: result[1])[0]


def placed(positions: np.ndarray, pose: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """[M, 3] float32: points moved by a pose from `place`, turned about `centre` [3]."""
    if not pose.any():
        return positions.astype(np.float32)
    turned = (positions - centre) @ _turn(pose[3]).T
    return (turned + centre + pose[:3]).astype(np.float32)


def _turn(yaw: float) -> np.ndarray:
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _align(positions: np.ndarray, observed: np.ndarray, yaw: float) -> tuple[np.ndarray, float]:
    """Pose from one start, and the mean distance of the observed points to the placed shape."""
    centre = positions.mean(axis=0)
    pose = np.array([*(observed.mean(axis=0) - centre), yaw])
    error = np.inf
    for _ in range(ITERATIONS):
        moved = (positions - centre) @ _turn(pose[3]).T + centre + pose[:3]
        distances, nearest = cKDTree(moved).query(observed)
        error = float(distances.mean())
        source, target = positions[nearest] - centre, observed
        source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
        angle = turn_about_vertical(source, target)
        pose = np.array([*(target_mean - _turn(angle) @ source_mean - centre), angle])
    return pose, error
