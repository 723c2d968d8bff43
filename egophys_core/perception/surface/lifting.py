"""Tracks in pixels -> points in the world (the paper, Eq. `vggt_lift` and Appendix B.1)."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.options import number, validate
from egophys_core.perception.stages import PointMap, Tracks

DEPTH_EDGE = 0.03
"""Pixels whose depths differ by more than this share are of two surfaces; one tilted by 80 degrees differs by less."""


@dataclass(frozen=True, kw_only=True)
class LiftOptions:
    """Which points of a point map are believed; the defaults are the paper's."""

    min_confidence: float = number(0.5, low=0.0, high=1.0, doc="lowest confidence of a point that is used")
    min_depth_m: float = number(0.2, low=0.0, high=100.0, doc="nearest distance along the view of a point, metres")
    max_depth_m: float = number(1.5, low=0.0, high=100.0, doc="farthest distance along the view of a point, metres")

    def __post_init__(self) -> None:
        validate(self)


@dataclass(frozen=True, kw_only=True)
class LiftedTracks:
    """Places of N tracked points in the world over T views."""

    points: np.ndarray
    """[T, N, 3] float32, metres, frame world; NaN where not seen or not believed."""
    confidence: np.ndarray
    """[T, N] float32 in 0..1; 0 where the point is NaN."""


def lift(
    tracks: Tracks,
    point_maps: Iterable[PointMap],
    world_from_camera: np.ndarray,
    options: LiftOptions | None = None,
) -> LiftedTracks:
    """Look each visible track up in the point map of its view; the maps are taken one by one and not kept.

    The depth range holds for the distance along the camera's axis. (The paper writes (p)_z: in the frame of VGGT,
    which is that of a camera, this is the same.) In a view without a known pose no depth is known: nothing is lifted.

    Args:
        tracks: T views, N tracks.
        point_maps: T maps [S, S].
        world_from_camera: [T, 4, 4] poses of the views, metres; NaN where not known.
        options: thresholds; None for the paper's.

    Raises:
        EpisodeError: the three are not of the same number of views.
    """
    options = options or LiftOptions()
    views, count = tracks.visible.shape
    if world_from_camera.shape != (views, 4, 4):
        raise EpisodeError(f"poses of {views} tracked views must be [{views}, 4, 4], got {world_from_camera.shape}")
    points = np.full((views, count, 3), np.nan, np.float32)
    confidence = np.zeros((views, count), np.float32)
    for view, point_map in zip_longest(range(views), point_maps):
        if view is None or point_map is None:
            which = "more" if view is None else f"only {view}"
            raise EpisodeError(f"there are {which} point maps for {views} tracked views; give one for each")
        pose = world_from_camera[view]
        seen = tracks.visible[view]
        if not np.isfinite(pose).all():
            continue
        found, certain = sample(point_map, tracks.pixels[view, seen], pose)
        depth = depths(found, pose)
        good = (certain >= options.min_confidence) & (depth >= options.min_depth_m) & (depth <= options.max_depth_m)
        points[view, seen] = np.where(good[:, None], found, np.nan)
        confidence[view, seen] = np.where(good, certain, 0.0)
    return LiftedTracks(points=points, confidence=confidence)


def sample(point_map: PointMap, pixels: np.ndarray, world_from_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and confidence between the pixels of a map, bilinear, but never across the edge of a surface.

    Of the four pixels around a place, those count that are known and whose depth differs from that of the nearest one
    by at most `DEPTH_EDGE`; their weights are made to add up to 1. Where the nearest is not known nothing is.

    Args:
        point_map: [S, S].
        pixels: [N, 2] x and y, pixel centres at integers.
        world_from_camera: [4, 4] pose of the view.

    Returns:
        [N, 3] float64 metres, NaN where unknown or outside the image, and [N] float64 in 0..1, 0 there.
    """
    height, width = point_map.confidence.shape
    x, y = pixels[:, 0].astype(np.float64), pixels[:, 1].astype(np.float64)
    inside = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)  # False for NaN
    x = np.clip(np.where(inside, x, 0.0), 0, width - 1)
    y = np.clip(np.where(inside, y, 0.0), 0, height - 1)
    left = np.minimum(np.floor(x).astype(int), max(width - 2, 0))
    top = np.minimum(np.floor(y).astype(int), max(height - 2, 0))
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    across, down = x - left, y - top
    columns = np.stack([left, right, left, right], axis=1)
    rows = np.stack([top, top, bottom, bottom], axis=1)
    weights = np.stack(
        [(1 - across) * (1 - down), across * (1 - down), (1 - across) * down, across * down],
        axis=1,
    )
    corners = point_map.points[rows, columns].astype(np.float64)  # [N, 4, 3]
    certain = point_map.confidence[rows, columns].astype(np.float64)
    known = np.isfinite(corners).all(axis=2) & (certain > 0)
    depth = depths(corners, world_from_camera)
    each, nearest = np.arange(len(x)), np.argmax(weights, axis=1)
    middle = depth[each, nearest]
    with np.errstate(invalid="ignore"):
        same = known & (np.abs(depth - middle[:, None]) <= DEPTH_EDGE * np.abs(middle[:, None]))
    found = inside & known[each, nearest]
    weights = np.where(same & found[:, None], weights, 0.0)
    weights /= np.where(found, weights.sum(axis=1), 1.0)[:, None]
    points = (weights[:, :, None] * np.where(same[:, :, None], corners, 0.0)).sum(axis=1)
    return np.where(found[:, None], points, np.nan), (weights * np.where(same, certain, 0.0)).sum(axis=1)


def depths(points: np.ndarray, world_from_camera: np.ndarray) -> np.ndarray:
    """[...] metres: distance of world points [..., 3] along the axis of a camera at pose [4, 4]; NaN stays NaN."""
    depth: np.ndarray = (points - world_from_camera[:3, 3]) @ world_from_camera[:3, 2]
    return depth
