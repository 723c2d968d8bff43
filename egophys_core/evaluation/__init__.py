"""Errors of a predicted motion and of what was made of a video, and the predictions without physics to beat."""

from egophys_core.evaluation.baselines import (
    baseline_scores,
    lagging_prediction,
    rigid_follow_prediction,
    static_prediction,
)
from egophys_core.evaluation.iou import iou_per_frame
from egophys_core.evaluation.lost_to import lost_to
from egophys_core.evaluation.masks import MaskScores, mask_scores
from egophys_core.evaluation.metrics import (
    bind_tracks,
    chamfer_per_frame,
    split_frames,
    track_error_per_frame,
    two_way_chamfer,
    two_way_chamfer_per_frame,
)
from egophys_core.evaluation.perception import (
    PointPaths,
    TrackedViews,
    follow_measured,
    pair_frames,
    pixels_of,
    points_in_masks,
    score_points,
    score_tracks,
)
from egophys_core.evaluation.places import Places, identify
from egophys_core.evaluation.point_tracks import PointTrackScores, first_visible, point_track_scores
from egophys_core.evaluation.reconstruction import (
    CameraPoseScores,
    ReconstructionScores,
    camera_pose_scores,
    reconstruction_scores,
)
from egophys_core.evaluation.scores import Scores, score

__all__ = [
    "CameraPoseScores",
    "MaskScores",
    "Places",
    "PointPaths",
    "PointTrackScores",
    "ReconstructionScores",
    "Scores",
    "TrackedViews",
    "baseline_scores",
    "bind_tracks",
    "camera_pose_scores",
    "chamfer_per_frame",
    "first_visible",
    "follow_measured",
    "identify",
    "iou_per_frame",
    "lagging_prediction",
    "lost_to",
    "mask_scores",
    "pair_frames",
    "pixels_of",
    "point_track_scores",
    "points_in_masks",
    "reconstruction_scores",
    "rigid_follow_prediction",
    "score",
    "score_points",
    "score_tracks",
    "split_frames",
    "static_prediction",
    "track_error_per_frame",
    "two_way_chamfer",
    "two_way_chamfer_per_frame",
]
