"""Geometry that several rooms need."""

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

THIN = 0.2
"""Share of the longest extent below which an object is thin that way."""


def thick_axes(extents: np.ndarray) -> np.ndarray:
    """[3] bool: the axes along which an object, of these extents [3] or halves of them, is not thin."""
    return extents > THIN * extents.max()


def spacing(points: np.ndarray) -> float:
    """Metres: median distance of points [N, 3] to their fourth-nearest others: a grid's spacing, strewn or not."""
    return float(np.median(cKDTree(points).query(points, k=min(5, len(points)))[0][:, -1]))


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """Indices, increasing, of at most `count` of the points [N, 3], each the farthest from those chosen before it.

    The first is the farthest from the mean; of equals the one of the lowest index, so nothing is random. Points that
    are not finite are never chosen.
    """
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(finite) <= count:
        return finite
    places = points[finite].astype(np.float64)
    first = int(np.argmax(np.linalg.norm(places - places.mean(axis=0), axis=1)))
    return np.sort(finite[farthest_first(places, count, first=first)[:count]])


def farthest_first(places: np.ndarray, count: int, *, first: int) -> np.ndarray:
    """Indices of `count` of the places [N, 3], the first given and each next one the farthest from all before it."""
    chosen = [first]
    distance = np.linalg.norm(places - places[first], axis=1)
    while len(chosen) < count:
        # Coincident places are at distance 0 as well as chosen ones, and are others.
        distance[chosen] = -1.0
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return np.array(chosen)


def nearest_rotation(matrices: np.ndarray) -> np.ndarray:
    """[..., 3, 3]: the rotation nearest to each matrix [..., 3, 3] in the sum of squared differences of their entries.

    Kabsch, Acta Cryst. A32 (1976) 922: of the products of paired points it is how one set is turned to the other.
    """
    left, _, right = np.linalg.svd(matrices)
    # A reflection may be nearer still.
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    return np.asarray(left @ right)


def smallest_rotation(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """[3, 3] the smallest rotation that turns one direction [3] into another; none if either has no length."""
    lengths = np.linalg.norm(source) * np.linalg.norm(target)
    if lengths < 1e-12:
        return np.eye(3)
    axis = np.cross(source, target) / lengths
    sine, cosine = float(np.linalg.norm(axis)), float(source @ target / lengths)
    if sine < 1e-9:
        # Directions that are opposite have no smallest rotation; about which axis does not matter.
        return np.eye(3) if cosine > 0.0 else 2.0 * np.outer(side := _aside(source), side) - np.eye(3)
    return np.asarray(Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)).as_matrix())


def about_vertical(vectors: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Vectors [..., 3] turned about z by angles [...], radians; by none they stay what they are, to the last bit."""
    cosines, sines = np.cos(angles), np.sin(angles)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    turned = np.empty((*np.broadcast_shapes(np.shape(x), np.shape(angles)), 3))
    turned[..., 0], turned[..., 1], turned[..., 2] = cosines * x - sines * y, sines * x + cosines * y, z
    return turned


def turn_about_vertical(source: np.ndarray, target: np.ndarray) -> float:
    """Radians about z that bring points [P, 3] nearest to others, each about their mean; 0 for points above another."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    return float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a[:, :2] * b[:, :2]).sum()))


def rigid_fit(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation [3, 3] and shift [3] that bring points [P, 3] nearest to others (Kabsch, Acta Cryst. A32 (1976) 922).

    Of all rotations that bring them as near it is the smallest: none for one point, none about the line of two.
    """
    middle, aim = source.mean(axis=0), target.mean(axis=0)
    if len(source) < 3:
        turn = smallest_rotation(source[-1] - source[0], target[-1] - target[0])
        return turn, aim - turn @ middle
    turn = nearest_rotation((source - middle).T @ (target - aim)).T
    return turn, aim - turn @ middle


def _aside(direction: np.ndarray) -> np.ndarray:
    """[3] a unit vector across a direction [3]."""
    across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    return np.asarray(across / np.linalg.norm(across))
