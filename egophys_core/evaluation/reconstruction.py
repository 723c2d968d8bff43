"""Errors of a reconstruction from video in space: of the identified points, and of the camera's poses."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError

SAME_PLACE_M = 0.02
"""Metres on the object at rest: an id that has slipped no farther still names the same place.

Over three spacings of the measured points (6 mm in the shipped videos), so that their noise of 1.5 mm does not count.
"""

ROTATION_TOLERANCE = 1e-4
"""Largest entry of R R^T - 1, and of the last row less 0 0 0 1, that passes: poses kept in float32 do."""


@dataclass(frozen=True, kw_only=True)
class ReconstructionScores:
    """Errors over all (frame, point) pairs that are both measured and reconstructed; NaN without any."""

    mean_m: float
    """Metres: mean Euclidean distance."""
    p95_m: float
    """Metres: 95th percentile of it."""
    coverage: float
    """0..1: share of the measured pairs that are reconstructed. Points never identified count as not reconstructed."""
    id_stability: float
    """0..1: share of the pairs at the same place of the object as at first (see `slip`)."""

    def as_dict(self) -> dict[str, float]:
        """Numbers for JSON, lengths in millimetres."""
        return {
            "mean_mm": self.mean_m * 1e3,
            "p95_mm": self.p95_m * 1e3,
            "coverage": self.coverage,
            "id_stability": self.id_stability,
        }


@dataclass(frozen=True, kw_only=True)
class CameraPoseScores:
    """Errors of the camera's pose in each frame; NaN where no pose was found."""

    position_m: np.ndarray
    """[T] metres: distance of the camera's centres."""
    angle_rad: np.ndarray
    """[T] radians, 0..pi: angle of the rotation between the two orientations."""

    def as_dict(self) -> dict[str, float]:
        """Means over the frames with a pose for JSON, in millimetres and degrees; NaN without any."""
        found = np.isfinite(self.position_m)
        if not found.any():
            return {"pose_mm": float("nan"), "pose_deg": float("nan"), "pose_coverage": 0.0}
        return {
            "pose_mm": float(self.position_m[found].mean()) * 1e3,
            "pose_deg": float(np.degrees(self.angle_rad[found].mean())),
            "pose_coverage": float(found.mean()),
        }


def reconstruction_scores(followed: np.ndarray, truth: np.ndarray, rest: np.ndarray) -> ReconstructionScores:
    """Compare reconstructed points with the measured ones they were identified with.

    Noise of the measured points is in the errors: 1.5 mm along each axis make a mean of 2.4 mm alone.

    Args:
        followed: [T, N, 3] metres, from `Places.follow`; NaN where not reconstructed.
        truth: [T, N, 3] metres, same frame; NaN where not measured.
        rest: [N, 3] metres, the measured points at rest, which the places were identified by; NaN where unknown.
    """
    if truth.ndim != 3 or truth.shape[2] != 3 or followed.shape != truth.shape or rest.shape != truth.shape[1:]:
        raise EpisodeError(
            f"points must be [T, N, 3] in metres with the rest [N, 3], got reconstructed {followed.shape}, "
            f"measured {truth.shape}, rest {rest.shape}"
        )
    measured = np.isfinite(truth).all(axis=2)
    both = measured & np.isfinite(followed).all(axis=2)
    coverage = np.count_nonzero(both) / np.count_nonzero(measured) if measured.any() else float("nan")
    if not both.any():
        nothing = float("nan")
        return ReconstructionScores(mean_m=nothing, p95_m=nothing, coverage=coverage, id_stability=nothing)
    errors = np.linalg.norm(followed[both] - truth[both], axis=1)
    slips = slip(followed, truth, rest)
    judged = np.isfinite(slips)
    return ReconstructionScores(
        mean_m=float(errors.mean()),
        p95_m=float(np.percentile(errors, 95)),
        coverage=coverage,
        id_stability=float(np.mean(slips[judged] <= SAME_PLACE_M)) if judged.any() else float("nan"),
    )


def slip(followed: np.ndarray, truth: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """[T, N] metres: how far an id has wandered on the object, apart from how far off the reconstruction is.

    It is the distance at rest between the point's own measured point and the measured one that it is nearest to in this
    frame. A whole shape that is off in depth has little slip; two ids that swap places have all of their distance.

    Args:
        followed: [T, N, 3] metres; NaN where not reconstructed.
        truth: [T, N, 3] metres; NaN where not measured.
        rest: [N, 3] metres; NaN where unknown.

    Returns:
        NaN where not both measured and reconstructed, and for points unknown at rest.
    """
    slips = np.full(followed.shape[:2], np.nan)
    known = np.isfinite(rest).all(axis=1)
    for frame, (here, there) in enumerate(zip(followed, truth, strict=True)):
        seen = np.flatnonzero(known & np.isfinite(there).all(axis=1))
        own = seen[np.isfinite(here[seen]).all(axis=1)]
        if len(own):
            nearest = seen[cKDTree(there[seen]).query(here[own])[1]]
            slips[frame, own] = np.linalg.norm(rest[nearest] - rest[own], axis=1)
    return slips


def camera_pose_scores(poses: np.ndarray, truth: np.ndarray) -> CameraPoseScores:
    """Compare the camera's poses in the same world; nothing is aligned.

    Args:
        poses: [T, 4, 4] world from camera (the last column is the camera's centre), metres; NaN where none was found.
        truth: [T, 4, 4] likewise, all finite.

    Raises:
        EpisodeError: shapes do not fit, or a matrix is not a rigid motion.
    """
    if truth.ndim != 3 or truth.shape[1:] != (4, 4) or poses.shape != truth.shape:
        raise EpisodeError(f"poses must be [T, 4, 4], found and true alike, got {poses.shape} and {truth.shape}")
    found = np.isfinite(poses).all(axis=(1, 2))
    _check_rigid(poses, np.flatnonzero(found), "found")
    _check_rigid(truth, np.arange(len(truth)), "true")
    turn = poses[:, :3, :3] @ truth[:, :3, :3].transpose(0, 2, 1)
    # Twice the sine and cosine of the angle; the arc cosine alone has no digits left near 0.
    axis = np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    angle = np.arctan2(np.linalg.norm(axis, axis=1), np.trace(turn, axis1=1, axis2=2) - 1)
    distance = np.linalg.norm(poses[:, :3, 3] - truth[:, :3, 3], axis=1)
    return CameraPoseScores(
        position_m=np.where(found, distance, np.nan),
        angle_rad=np.where(found, angle, np.nan),
    )


def _check_rigid(poses: np.ndarray, frames: np.ndarray, name: str) -> None:
    for frame in frames:
        pose = poses[frame]
        rotation = pose[:3, :3]
        skewed = max(np.abs(rotation @ rotation.T - np.eye(3)).max(), np.abs(pose[3] - [0, 0, 0, 1]).max())
        if not (np.isfinite(pose).all() and skewed <= ROTATION_TOLERANCE and np.linalg.det(rotation) > 0):
            raise EpisodeError(
                f"{name} pose of frame {frame} is no rotation with a translation:\n{pose}\n"
                "poses must be world from camera with last row 0 0 0 1, without scale or mirroring"
            )
