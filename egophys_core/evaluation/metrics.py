"""Errors of a predicted motion against observed points, as PhysTwin's evaluation defines them."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError


def bind_tracks(points: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """[N] int: for each ground-truth track its nearest vertex at frame 0; -1 for tracks unseen in frame 0.

    Args:
        points: [N, 3] metres, frame 0, NaN where unseen.
        vertices: [V, 3] metres, predicted, frame 0.
    """
    seen = np.isfinite(points).all(axis=1)
    bound = np.full(len(points), -1)
    bound[seen] = cKDTree(vertices).query(points[seen])[1]
    return bound


def track_error_per_frame(predicted: np.ndarray, points: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """[T] metres: mean Euclidean distance of the valid bound tracks to their vertices; NaN without any.

    Args:
        predicted: [T, V, 3] metres.
        points: [T, N, 3] metres, NaN where unseen.
        bound: [N] from `bind_tracks`.
    """
    tracks = np.flatnonzero(bound >= 0)
    distances = np.linalg.norm(predicted[:, bound[tracks]] - points[:, tracks], axis=2)
    return _mean_of_valid(distances)


def chamfer_per_frame(surface: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[T] metres: mean L1 distance of the visible points to the nearest predicted surface point, one way.

    The nearest point is the nearest in the L1 norm, the distance is not squared; NaN without visible points.

    Args:
        surface: [T, V, 3] metres, predicted surface points.
        points: [T, N, 3] metres, NaN where unseen.
    """
    errors = np.full(len(points), np.nan)
    for frame, (vertices, observed) in enumerate(zip(surface, points, strict=True)):
        seen = observed[np.isfinite(observed).all(axis=1)]
        if len(seen):
            errors[frame] = cKDTree(vertices).query(seen, p=1)[0].mean()
    return errors


def two_way_chamfer(one: np.ndarray, other: np.ndarray) -> float:
    """Metres: mean Euclidean distance to the nearest point of the other set, averaged over both ways.

    Args:
        one: [A, 3] metres.
        other: [B, 3] metres.
    """
    there = cKDTree(other).query(one)[0].mean()
    back = cKDTree(one).query(other)[0].mean()
    return float((there + back) / 2)


def two_way_chamfer_per_frame(predicted: np.ndarray, points: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """[T] metres: two-way Chamfer distance of the visible bound tracks and their vertices; NaN without any.

    A vertex whose track is hidden has no observed point near it, through no fault of the prediction: on the way
    back all of the surface would count as wrong what was merely not seen. So a vertex counts when its track does.

    Args:
        predicted: [T, V, 3] metres.
        points: [T, N, 3] metres, NaN where unseen.
        bound: [N] from `bind_tracks`.
    """
    pairs = visible_pairs(predicted, points, bound)
    return np.array([two_way_chamfer(*pair) if len(pair[0]) else np.nan for pair in pairs])


def visible_pairs(
    predicted: np.ndarray, points: np.ndarray, bound: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Per frame the bound tracks seen in it [K, 3] metres, after the vertices they are bound to [K, 3] metres."""
    for vertices, observed in zip(predicted, points, strict=True):
        seen = np.isfinite(observed).all(axis=1) & (bound >= 0)
        yield vertices[bound[seen]], observed[seen]


def split_frames(episode: Episode) -> dict[str, slice]:
    """Frames of each part: train 1 .. floor(0.7 T) - 1, test floor(0.7 T) .. T - 1, all 1 .. T - 1."""
    split = episode.train_frames
    if split < 2 or split >= episode.frames:
        raise EpisodeError(
            f"{episode.name}: {episode.frames} frames leave {max(split - 1, 0)} to fit and "
            f"{episode.frames - split} to hold out; record at least 4"
        )
    return {"train": slice(1, split), "test": slice(split, None), "all": slice(1, None)}


def _mean_of_valid(distances: np.ndarray) -> np.ndarray:
    valid = np.isfinite(distances)
    count = valid.sum(axis=1)
    total = np.where(valid, distances, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
