"""Scores: the errors of one prediction of one episode on its train, test and all frames."""

from dataclasses import asdict, dataclass

import numpy as np

from egophys_core.episode import Episode
from egophys_core.evaluation.iou import iou_per_frame
from egophys_core.evaluation.metrics import (
    bind_tracks,
    chamfer_per_frame,
    split_frames,
    track_error_per_frame,
    two_way_chamfer_per_frame,
)


@dataclass(frozen=True, kw_only=True)
class Scores:
    """Mean over points and then over frames: train 1 .. floor(0.7 T) - 1, test the rest, all but the first."""

    train_chamfer_m: float
    """Chamfer distance, metres: visible points to the nearest surface vertex, one way, L1."""
    test_chamfer_m: float
    all_chamfer_m: float
    train_track_m: float
    """Track error, metres: visible points to the vertices they are bound to at frame 0."""
    test_track_m: float
    all_track_m: float
    train_two_way_chamfer_m: float
    """Two-way Chamfer distance, metres: visible points and their vertices, both ways, L2."""
    test_two_way_chamfer_m: float
    all_two_way_chamfer_m: float
    train_iou: float
    """Overlap of the silhouettes of visible points and their vertices, 0..1 (see `iou`)."""
    test_iou: float
    all_iou: float

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
    measured = {
        "chamfer_m": chamfer_per_frame(visible, episode.points),
        "track_m": track_error_per_frame(visible, episode.points, bound),
        "two_way_chamfer_m": two_way_chamfer_per_frame(visible, episode.points, bound),
        "iou": iou_per_frame(visible, episode.points, bound),
    }
    means = {
        f"{part}_{name}": float(np.nanmean(values[frames])) if np.isfinite(values[frames]).any() else float("nan")
        for part, frames in split_frames(episode).items()
        for name, values in measured.items()
    }
    return Scores(**means)
