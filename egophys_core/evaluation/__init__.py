"""Errors of a predicted motion, and the predictions without physics to compare with."""

from egophys_core.evaluation.baselines import baseline_scores, rigid_follow_prediction, static_prediction
from egophys_core.evaluation.iou import iou_per_frame
from egophys_core.evaluation.metrics import (
    bind_tracks,
    chamfer_per_frame,
    split_frames,
    track_error_per_frame,
    two_way_chamfer,
    two_way_chamfer_per_frame,
)
from egophys_core.evaluation.scores import Scores, score

__all__ = [
    "Scores",
    "baseline_scores",
    "bind_tracks",
    "chamfer_per_frame",
    "iou_per_frame",
    "rigid_follow_prediction",
    "score",
    "split_frames",
    "static_prediction",
    "track_error_per_frame",
    "two_way_chamfer",
    "two_way_chamfer_per_frame",
]
