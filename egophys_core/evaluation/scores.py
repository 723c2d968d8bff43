"""Scores: the errors of one prediction of one episode on its train, test and all frames."""

from dataclasses import asdict, dataclass

import numpy as np

from egophys_core.episode import Episode
from egophys_core.evaluation.metrics import (
    bind_tracks,
    chamfer_per_frame,
    split_frames,
    track_error_per_frame,
)


@dataclass(frozen=True, kw_only=True)
class Scores:
    """Chamfer distance and track error, metres, mean over points and then over frames."""

    train_chamfer_m: float
    test_chamfer_m: float
    all_chamfer_m: float
    train_track_m: float
    test_track_m: float
    all_track_m: float

    def as_dict(self) -> dict[str, float]:
        """Plain numbers by name, for JSON."""
        return asdict(self)


def score(predicted: np.ndarray, surface: np.ndarray, episode: Episode) -> Scores:
    """Compare a predicted motion with what was observed.

    Args:
        predicted: [T, V, 3] metres, world, at the episode's times.
        surface: [V] bool, which vertices can be seen.
        episode: the observation.
    """
    visible = predicted[:, surface]
    bound = bind_tracks(episode.points[0], visible[0])
    chamfer = chamfer_per_frame(visible, episode.points)
    track = track_error_per_frame(visible, episode.points, bound)
    errors = {
        f"{part}_{name}_m": float(np.nanmean(values[frames])) if np.isfinite(values[frames]).any() else float("nan")
        for part, frames in split_frames(episode).items()
        for name, values in (("chamfer", chamfer), ("track", track))
    }
    return Scores(**errors)
