"""Errors of a perceived episode, and of a twin from it, against what was measured; defined in `benchmarks/film.py`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from egophys_core.episode import Episode
from egophys_core.evaluation import (
    PointPaths,
    bind_tracks,
    follow_measured,
    pair_frames,
    score_points,
    track_error_per_frame,
)
from egophys_core.observation import Hand

CONFIDENT = 0.5
WRONG_M = 0.015


@dataclass(frozen=True, kw_only=True)
class StampedEpisode:
    """An episode whose frames can be paired with those of another one."""

    episode: Episode
    stamps_ns: np.ndarray
    """[T] int64, nanoseconds."""

    @property
    def confident(self) -> PointPaths:
        """Its points while they are sure enough."""
        sure = self.episode.confidence[..., None] >= CONFIDENT
        return PointPaths(stamps_ns=self.stamps_ns, points=np.where(sure, self.episode.points, np.nan).astype(float))


def surface_errors(found: StampedEpisode, truth: StampedEpisode) -> dict[str, float]:
    """How far off its points are, how many there are, and how many of them are wrong."""
    paths = truth.confident
    scores = score_points(found.confident, paths)
    followed = follow_measured(found.confident, paths)
    errors = np.linalg.norm(followed - paths.points, axis=2)
    measured, both = np.isfinite(paths.points).all(axis=2), np.isfinite(errors)
    seconds = _full_seconds(truth.stamps_ns)
    return {
        "surface_mean_mm": 1e3 * scores.mean_m,
        "surface_p95_mm": 1e3 * scores.p95_m,
        "coverage": scores.coverage,
        "least_coverage_second": min(both[each].sum() / max(measured[each].sum(), 1) for each in seconds),
        "wrong_share_confident": float((errors[both] > WRONG_M).mean()) if both.any() else float("nan"),
    }


def hand_errors(
    found: StampedEpisode, groups: Sequence[np.ndarray], truth: StampedEpisode, hands: Sequence[Hand]
) -> dict[str, Any]:
    """How far the middle of each measured hand is from that of the perceived one assigned to it.

    Args:
        found: perceived.
        groups: indices of the controllers of each of its hands.
        truth: measured.
        hands: its hands.
    """
    pairs = pair_frames(truth.stamps_ns, found.stamps_ns)
    mean = np.full((len(hands), len(groups)), np.nan)
    for row, hand in enumerate(hands):
        if not hand.touches:
            continue
        frames = np.arange(hand.first, truth.episode.frames)
        frames = frames[pairs[frames] >= 0]
        middle = truth.episode.controllers[np.ix_(frames, hand.controllers)].mean(axis=1)
        for column, group in enumerate(groups):
            other = found.episode.controllers[np.ix_(pairs[frames], group)].mean(axis=1)
            mean[row, column] = np.linalg.norm(other - middle, axis=1).mean()
    off = [float("nan")] * len(hands)
    known = np.flatnonzero(np.isfinite(mean).all(axis=1)) if len(groups) else np.zeros(0, int)
    for row, column in zip(*linear_sum_assignment(mean[known]), strict=True):
        off[known[row]] = 1e3 * float(mean[known[row], column])
    return {"hands": f"{len(groups)} of {len(hands)}", "hand_mean_mm": off}


def held_out_error(nodes: np.ndarray, stamps_ns: np.ndarray, truth: StampedEpisode) -> float:
    """Millimetres: mean over the held-out measured frames of the mean distance of the points to their nodes.

    Args:
        nodes: [T, S, 3] metres, surface nodes over time; at rest in the first frame.
        stamps_ns: [T] of these frames.
        truth: measured; each point belongs to the node nearest to it in the first frame.
    """
    points, pairs = truth.episode.points, pair_frames(truth.stamps_ns, stamps_ns)
    bound = bind_tracks(points[0], nodes[0])
    there = np.where(pairs[:, None, None] >= 0, nodes[pairs], np.nan)
    return 1e3 * float(np.nanmean(track_error_per_frame(there, points, bound)[truth.episode.train_frames :]))


def _full_seconds(stamps_ns: np.ndarray) -> list[np.ndarray]:
    """Frames of each second that lasts to its end, but for half a frame."""
    since = stamps_ns - stamps_ns[0]
    step = float(np.median(np.diff(stamps_ns)))
    seconds = [np.flatnonzero(since // 1_000_000_000 == index) for index in range(int((since[-1] + 1.5 * step) * 1e-9))]
    return [each for each in seconds if len(each)]
