"""Errors of what was made of a video, against points that were measured while it was filmed.

Frames are paired by stamp. The reconstructed points that stand for a measured one are found once, at rest, and then
followed by their ids (see `places`): a point that drifts over the object, or ids that swap, show as errors.
"""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError
from egophys_core.evaluation.places import identify
from egophys_core.evaluation.point_tracks import THRESHOLDS, PointTrackScores, point_track_scores
from egophys_core.evaluation.reconstruction import ReconstructionScores, reconstruction_scores

STILL_S = 0.5
"""Seconds at the start over which points are averaged to identify them; hands come later, and 15 frames leave 0.4 mm
of a noise of 1.5 mm."""
REACH_SPACINGS = 2.0
"""Spacings of the reconstructed points, beyond which none stands for a measured point."""


@dataclass(frozen=True, kw_only=True)
class PointPaths:
    """Points over time."""

    stamps_ns: np.ndarray
    """[T] int64, nanoseconds, strictly increasing."""
    points: np.ndarray
    """[T, N, 3] metres, frame world; NaN where not known."""

    def __post_init__(self) -> None:
        if self.points.ndim != 3 or self.points.shape[2] != 3 or self.stamps_ns.shape != self.points.shape[:1]:
            raise EpisodeError(
                f"points must be [T, N, 3] in metres with [T] stamps, got {self.points.shape} and "
                f"{self.stamps_ns.shape}"
            )
        if len(self.stamps_ns) == 0 or (np.diff(self.stamps_ns) <= 0).any():
            raise EpisodeError(f"{len(self.stamps_ns)} stamps that do not increase strictly; sort the frames by stamp")

    @property
    def rest(self) -> np.ndarray:
        """[N, 3] metres: means over the first `STILL_S`; NaN for points not known then."""
        still = self.stamps_ns - self.stamps_ns[0] <= STILL_S * 1e9
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a mean of nothing is NaN, as wanted
            return np.asarray(np.nanmean(self.points[still], axis=0, dtype=float))


@dataclass(frozen=True, kw_only=True)
class TrackedViews:
    """Points followed in the views of a moving camera."""

    paths: PointPaths
    """The points in space."""
    pixels: np.ndarray
    """[T, N, 2]: where each is in its view."""
    visible: np.ndarray
    """[T, N] bool: said to be seen."""
    world_from_camera: np.ndarray
    """[T, 4, 4] metres; NaN where not known."""
    camera_matrix: np.ndarray
    """[3, 3] pixels."""
    size: tuple[int, int]
    """Width and height of the views, pixels."""


def pair_frames(stamps_ns: np.ndarray, others_ns: np.ndarray) -> np.ndarray:
    """[T] int: for each of the increasing stamps [T] the index of the nearest other; -1 beyond half a frame.

    A frame is the median step of the stamps; with one stamp only an equal one pairs.
    """
    half = float(np.median(np.diff(stamps_ns))) / 2 if len(stamps_ns) > 1 else 0.0
    if len(others_ns) == 0:
        return np.full(len(stamps_ns), -1)
    after = np.searchsorted(others_ns, stamps_ns).clip(0, len(others_ns) - 1)
    before = (after - 1).clip(0)
    nearest = np.where(np.abs(others_ns[before] - stamps_ns) <= np.abs(others_ns[after] - stamps_ns), before, after)
    return np.where(np.abs(others_ns[nearest] - stamps_ns) <= half, nearest, -1)


def score_points(found: PointPaths, measured: PointPaths) -> ReconstructionScores:
    """Errors in space; measured frames without a reconstructed one count as not reconstructed."""
    return reconstruction_scores(follow_measured(found, measured), measured.points, measured.rest)


def follow_measured(found: PointPaths, measured: PointPaths) -> np.ndarray:
    """[T, N, 3] metres: where reconstruction has each measured point in each measured frame; NaN where it does not."""
    places = identify(found.rest, measured.rest, _radius(found.rest))
    return _at_frames(places.follow(found.points), pair_frames(measured.stamps_ns, found.stamps_ns))


def score_tracks(views: TrackedViews, measured: PointPaths, *, poses: np.ndarray | None = None) -> PointTrackScores:
    """Errors in the image: the true track of a measured point is its projection.

    Views without measured points or a pose are left out. A measured point counts as visible wherever it was measured
    and lies in the image. Of a place mixed of several points the visibility is that of most of its weight. Noise of
    the measured points is in the errors: 1.5 mm are about a pixel of a view of 518.

    Args:
        views: what was found.
        measured: what was measured.
        poses: [T, 4, 4] true poses of the views, world from camera; those found if None. NaN where not known.
    """
    rest = measured.rest
    found = views.paths
    places = identify(found.rest, rest, _radius(found.rest))
    pairs = pair_frames(found.stamps_ns, measured.stamps_ns)
    poses = views.world_from_camera if poses is None else poses
    kept = np.flatnonzero((pairs >= 0) & np.isfinite(poses).all(axis=(1, 2)))
    if len(kept) == 0:
        nothing = np.full(len(THRESHOLDS), np.nan)
        return PointTrackScores(within=nothing, jaccard=nothing, occlusion_accuracy=float("nan"))
    truth = np.stack([pixels_of(measured.points[pairs[view]], views.camera_matrix, poses[view]) for view in kept])
    with np.errstate(invalid="ignore"):
        inside = ((truth > -0.5) & (truth < np.array(views.size) - 0.5)).all(axis=2)
    said = np.where(places.weights > 0, places.weights * views.visible[kept][:, places.corners], 0).sum(axis=2) > 0.5
    return point_track_scores(places.follow(views.pixels[kept]), said, truth, inside, views.size)


def points_in_masks(
    masks: Iterable[np.ndarray], views: TrackedViews, measured: PointPaths, *, poses: np.ndarray | None = None
) -> float:
    """Share of the measured points whose projection lies in the mask of its view, 0..1; NaN without any.

    A lower bound of the recall of masks whose truth is not known; what a mask has too much it does not tell.

    Args:
        masks: T masks [H, W] bool, of the views; taken one by one.
        views: their stamps, poses and intrinsics.
        measured: points on the masked object.
        poses: [T, 4, 4] true poses of the views; those found if None.
    """
    poses = views.world_from_camera if poses is None else poses
    hits = asked = 0
    frames = pair_frames(views.paths.stamps_ns, measured.stamps_ns)
    for mask, frame, pose in zip(masks, frames, poses, strict=True):
        if frame < 0 or not np.isfinite(pose).all():
            continue
        pixels = pixels_of(measured.points[frame], views.camera_matrix, pose)
        columns, rows = np.rint(pixels[np.isfinite(pixels).all(axis=1)]).astype(int).T
        inside = (columns >= 0) & (rows >= 0) & (columns < views.size[0]) & (rows < views.size[1])
        asked += np.count_nonzero(inside)
        hits += np.count_nonzero(mask[rows[inside], columns[inside]])
    return hits / asked if asked else float("nan")


def pixels_of(points: np.ndarray, camera_matrix: np.ndarray, world_from_camera: np.ndarray) -> np.ndarray:
    """[N, 2] pixels of points [N, 3] metres; NaN where a point is not known or not in front of the camera."""
    seen = (points - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    depth = np.where(seen[:, 2:] > 0, seen[:, 2:], np.nan)
    return np.asarray(seen[:, :2] / depth @ camera_matrix[:2, :2].T + camera_matrix[:2, 2])


def _radius(points: np.ndarray) -> float:
    """Metres within which points [N, 3] stand for a place: so many median distances to the nearest other one."""
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) < 2:
        raise EpisodeError(f"{len(known)} reconstructed points are known at the start; none can be identified there")
    return REACH_SPACINGS * float(np.median(cKDTree(known).query(known, k=2)[0][:, 1]))


def _at_frames(paths: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """[T, N, 3]: the paths at these frames; NaN at -1."""
    chosen = paths[frames]
    chosen[frames < 0] = np.nan
    return np.asarray(chosen)
