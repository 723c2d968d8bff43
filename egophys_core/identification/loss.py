"""The rollout loss of the coarse fit: geometry plus motion discrepancy (paper, coarse-fit objective)."""

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.evaluation import chamfer_per_frame, track_error_per_frame
from egophys_core.observation.problem import FitProblem

TAIL_SHARE = 0.25
"""Share of the frames, the last ones, that counts twice.

The twin is to predict what comes after the fitted frames. Among candidates of nearly equal loss the error on the
last frames tells the held-out error (correlation 0.43), the error on all frames does not (docs/notes/coarse_fit.md).
"""

SMALLEST_DISTANCE = 1e-9
"""Metres. Guards the direction of an offset of no length, which becomes 0."""


def rollout_loss(predicted: np.ndarray, surface: np.ndarray, bound: np.ndarray, observed: np.ndarray) -> float:
    """One-way Chamfer distance plus track error, metres: mean of that over all frames and over the last ones.

    Args:
        predicted: [F, V, 3] metres, nodes.
        surface: [V] bool, nodes that can be seen.
        bound: [N] surface node of each track, -1 for none.
        observed: [F, N, 3] metres, NaN where unseen.

    Returns:
        Infinity if the prediction is not finite.
    """
    visible = predicted[:, surface]
    if not np.isfinite(visible).all():
        return float("inf")
    tail = int((1.0 - TAIL_SHARE) * len(visible))
    errors = (chamfer_per_frame(visible, observed), track_error_per_frame(visible, observed, bound))
    return float(sum(np.nanmean(error) + np.nanmean(error[tail:]) for error in errors) / 2)


def errors_and_gradient(
    positions: np.ndarray, surface: np.ndarray, problem: FitProblem, frames: np.ndarray, *, fitted: int
) -> tuple[np.ndarray, np.ndarray]:
    """Chamfer distance plus track error in some frames of a rollout, and the derivative of its mean over the first.

    Args:
        positions: [F, V, 3] metres, nodes from the problem's first frame on.
        surface: [V] bool, nodes that can be seen.
        frames: [L] frames of the episode.
        fitted: over how many of them, the first ones, the mean is differentiated.

    Returns:
        [L] errors, metres, and [F, V, 3] the derivative by the positions; infinity and 0 if these are not finite.
    """
    rows, observed = frames - problem.first_frame, problem.episode.points[frames]
    predicted, seeds = positions[rows].astype(np.float64), np.zeros(positions.shape)
    if not np.isfinite(predicted).all():
        return np.full(len(frames), np.inf), seeds
    errors = chamfer_per_frame(predicted[:, surface], observed)
    errors += track_error_per_frame(predicted[:, surface], observed, problem.bound)
    part = slice(0, fitted)
    seeds[rows[part]] = loss_gradient(predicted[part], surface, problem.bound, observed[part]) / fitted
    return errors, seeds


def loss_gradient(predicted: np.ndarray, surface: np.ndarray, bound: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """[F, V, 3]: derivative by the predicted nodes of the sum over frames of Chamfer distance plus track error.

    Which node is nearest to an observed point is taken as fixed. Arguments as `rollout_loss`.
    """
    gradient = np.zeros(predicted.shape)
    nodes = np.flatnonzero(surface)
    for frame, (vertices, points) in enumerate(zip(predicted[:, surface], observed, strict=True)):
        seen = np.isfinite(points).all(axis=1)
        if not seen.any():
            continue
        nearest = cKDTree(vertices).query(points[seen], p=1)[1]
        np.add.at(gradient[frame], nodes[nearest], np.sign(vertices[nearest] - points[seen]) / seen.sum())
        tracks = np.flatnonzero(seen & (bound >= 0))
        if len(tracks):
            offset = vertices[bound[tracks]] - points[tracks]
            distance = np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), SMALLEST_DISTANCE)
            np.add.at(gradient[frame], nodes[bound[tracks]], offset / distance / len(tracks))
    return gradient
