"""A hand of known landmarks before a known camera."""

import cv2
import numpy as np

from egophys_core.perception.stages import HandLandmarks

MATRIX = np.array([[450.0, 0, 258.5], [0, 440, 250], [0, 0, 1]])
KNUCKLES = [(-0.025, -0.025), (-0.03, -0.09), (-0.005, -0.095), (0.018, -0.09), (0.038, -0.08)]
BONES = [(0.045, 0.035, 0.03), (0.045, 0.026, 0.022), (0.05, 0.03, 0.023), (0.045, 0.028, 0.023), (0.035, 0.02, 0.02)]
SPREAD = [(-0.7, -0.7), (-0.15, -1), (0, -1), (0.1, -1), (0.25, -1)]


def flat_hand() -> np.ndarray:
    """[21, 3] metres: fingers up and stretched, the thumb away from them."""
    points = np.zeros((21, 3))
    for finger, (knuckle, bones, way) in enumerate(zip(KNUCKLES, BONES, SPREAD, strict=True)):
        along = np.append(way, 0.0) / np.linalg.norm(way)
        places = np.append(knuckle, 0.0) + np.outer([0, *np.cumsum(bones)], along)
        points[1 + 4 * finger : 5 + 4 * finger] = places
    return points - points.mean(axis=0)


def pinching_hand() -> np.ndarray:
    """[21, 3] metres: the tips of thumb (4) and index finger (8) are 16 mm apart."""
    points = flat_hand()
    meeting = (points[5] + points[2]) / 2 + [-0.01, -0.04, -0.03]
    points[8], points[4] = meeting + [0, -0.008, 0], meeting + [0, 0.008, 0]
    points[7], points[3] = (points[6] + points[8]) / 2, (points[2] + points[4]) / 2
    return points - points.mean(axis=0)


def turned(points: np.ndarray, *axis: float) -> np.ndarray:
    """Points after a turn by an axis times an angle, radians."""
    return np.asarray(points @ cv2.Rodrigues(np.array(axis))[0].T)


def in_camera(
    metric: np.ndarray, pixel: tuple[float, float], depth: float, *, matrix: np.ndarray = MATRIX
) -> np.ndarray:
    """[21, 3] metres, frame camera: a hand at a pixel, as a camera that looks straight at that pixel sees it."""
    ray = np.linalg.solve(matrix, [*pixel, 1.0])
    across = np.hypot(*ray[:2])
    axis = np.array([-ray[1], ray[0], 0.0]) / max(across, 1e-12)
    return np.asarray(turned(metric, *(np.arctan(across) * axis)) + depth * ray)


def seen_hand(
    metric: np.ndarray,
    pixel: tuple[float, float],
    depth: float,
    *,
    score: float = 0.9,
    matrix: np.ndarray = MATRIX,
) -> HandLandmarks:
    """The exact landmarks of a hand at a pixel."""
    through = in_camera(metric, pixel, depth, matrix=matrix) @ matrix.T
    return HandLandmarks(pixels=through[:, :2] / through[:, 2:], metric=metric, right=1.0, score=score)
