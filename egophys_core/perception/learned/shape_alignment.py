"""Where a generated shape of unknown place, size and heading lies: ICP with scale onto the visible points."""

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.similarity import Similarity, fit_similarity

YAW_STARTS = 12
SCALE_STARTS = (0.8, 1.0, 1.25)
SCALE_RANGE = 2.0
"""The scale stays within this factor of what the widths of shape and visible points say."""
FURTHEST_MATCH = 4.0
"""Visible points farther from the shape than so many times their median are left out: they may be no part of it."""
FIRST_STEPS, LAST_STEPS = 15, 100
REFINED = 16
"""So many of the best starts are followed to the end."""
MOST_POINTS = 1000
"""Of more visible points, so many evenly taken are matched."""


def align_shape(shape: np.ndarray, visible: np.ndarray) -> tuple[Similarity, float]:
    """The similarity that puts a shape where its visible points are.

    The shape stands upright (z up) in both frames, its heading is not known: ICP starts from twelve headings and three
    sizes, with the tops and the middles of both together, and is free to turn in any way from there. The best is
    that from whose surface the visible points are the least distant; hidden parts do not count.

    Args:
        shape: [P, 3] points on the whole surface, any unit.
        visible: [V, 3] metres, points on the side that was seen.

    Returns:
        World from shape, and the mean distance in metres from visible points to the shape.

    Raises:
        EpisodeError: fewer than four points of either, points that are not finite, or all of them at one place.
    """
    for name, points in (("shape", shape), ("visible", visible)):
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4 or not np.isfinite(points).all():
            raise EpisodeError(f"{name} points must be [4 or more, 3] and finite, got {points.shape}")
        if width(points) <= 0:
            raise EpisodeError(f"{name} points are all above each other; nothing can be aligned to them")
    visible = visible[np.linspace(0, len(visible) - 1, min(len(visible), MOST_POINTS)).astype(int)].astype(np.float64)
    tree = cKDTree(shape)
    size = width(visible) / width(shape)
    candidates = [
        _icp(tree, visible, _start(tree.data, visible, yaw, size * factor), size, FIRST_STEPS)
        for yaw in np.arange(YAW_STARTS) * 2 * np.pi / YAW_STARTS
        for factor in SCALE_STARTS
    ]
    candidates.sort(key=lambda candidate: _distance(tree, visible, candidate))
    refined = [_icp(tree, visible, candidate, size, LAST_STEPS) for candidate in candidates[:REFINED]]
    best = min(refined, key=lambda candidate: _distance(tree, visible, candidate))
    return best, _distance(tree, visible, best)


def width(points: np.ndarray) -> float:
    """Largest extent of points [N, 3] along a horizontal direction, the same however they are turned about z."""
    angles = np.arange(0, np.pi, np.pi / 36)
    along = points[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    return float((along.max(axis=0) - along.min(axis=0)).max())


def _start(shape: np.ndarray, visible: np.ndarray, yaw: float, scale: float) -> Similarity:
    cosine, sine = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return Similarity(scale=scale, rotation=rotation, translation=_crown(visible) - scale * _crown(shape @ rotation.T))


def _crown(points: np.ndarray) -> np.ndarray:
    """The middle of the bounding box, at the height of its top: the top of an object on a table is seen."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.append((low[:2] + high[:2]) / 2, high[2])


def _icp(tree: cKDTree, visible: np.ndarray, start: Similarity, size: float, steps: int) -> Similarity:
    now = start
    before: np.ndarray | None = None
    for _ in range(steps):
        distance, nearest = tree.query(now.apply_inverse(visible))
        if before is not None and np.array_equal(nearest, before):
            break
        before = nearest
        matched = distance <= FURTHEST_MATCH * np.median(distance)
        pairs = tree.data[nearest[matched]], visible[matched]
        if len(pairs[0]) < 3 or np.ptp(pairs[0], axis=0).max() <= 0:
            break
        now = fit_similarity(*pairs)
        scale = float(np.clip(now.scale, size / SCALE_RANGE, size * SCALE_RANGE))
        middle = pairs[1].mean(axis=0) - scale * now.rotation @ pairs[0].mean(axis=0)
        now = Similarity(scale=scale, rotation=now.rotation, translation=middle)
    return now


def _distance(tree: cKDTree, visible: np.ndarray, world_from_shape: Similarity) -> float:
    return float(tree.query(world_from_shape.apply_inverse(visible))[0].mean() * world_from_shape.scale)
