"""The paper's path from views to an episode, over stages that can each be replaced (Sec. 3.1, Appendix B.1).

Masks -> tracks of queries in the first view -> point maps -> lift -> filters -> controllers. The stages of `learned`
fit in here; `perceive` has a path of its own, which needs no weights.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.geometry import farthest_points
from egophys_core.perception.options import PerceptionOptions
from egophys_core.perception.stages import Completer, PointMapper, Segmenter, Tracker, View
from egophys_core.perception.surface.lifting import LiftOptions, lift
from egophys_core.perception.surface.track_filter import (
    above_ground,
    consistent_motion,
    mask_hits,
    stays_in_mask,
    visible_throughout,
)


@dataclass(frozen=True, kw_only=True)
class StageSet:
    """The stages of the path."""

    segmenter: Segmenter
    tracker: Tracker
    point_mapper: PointMapper
    completer: Completer | None
    """Makes the hidden side of a solid; None leaves it out."""


def episode_from_stages(
    views: Callable[[], Iterable[View]],
    segmenter: Segmenter,
    tracker: Tracker,
    point_mapper: PointMapper,
    *,
    name: str,
    ground_height: float = 0.0,
    options: PerceptionOptions | None = None,
) -> Episode:
    """Track, lift and filter; the views are gone through a few times and never kept.

    Args:
        views: gives the views anew at each call, in order, object and hand both in the first.
        segmenter: masks of object and hand.
        tracker: tracks of the queries.
        point_mapper: world points of the pixels.
        name: of the episode.
        ground_height: z of the table, metres.
        options: of perception; thresholds and counts are the paper's by default.

    Raises:
        EpisodeError: nothing in the masks of the first view, or no object point or controller is left.
    """
    options = options or PerceptionOptions()
    first = next(iter(segmenter.masks(views())), None)
    if first is None or not (first.object | first.hand).any():
        raise EpisodeError(f"{name}: neither object nor hand is in the first view; start where both are seen")
    frames = [(view.stamp_ns, view.world_from_camera) for view in views()]
    tracks = tracker.tracks(views(), _queries(first.object | first.hand, options.queries))
    hits = mask_hits(tracks, segmenter.masks(views()))
    thresholds = LiftOptions(
        min_confidence=options.least_confidence, min_depth_m=options.nearest_m, max_depth_m=options.farthest_m
    )
    lifted = lift(tracks, point_mapper.point_maps(views()), np.array([pose for _, pose in frames]), thresholds)

    def points_in(in_mask: np.ndarray) -> np.ndarray:
        kept = stays_in_mask(in_mask, tracks.visible)
        points = np.where(in_mask[:, kept, None], lifted.points[:, kept], np.nan)
        points[~consistent_motion(points)] = np.nan
        points[~above_ground(points, ground_height, margin=options.ground_margin_m)] = np.nan
        return points

    on_object, on_hand = points_in(hits.object), points_in(hits.hand)
    on_object = on_object[:, np.isfinite(on_object[0]).all(axis=1)]
    on_hand = on_hand[:, visible_throughout(np.isfinite(on_hand).all(axis=2))]
    for what, points in (("object", on_object), ("hand", on_hand)):
        if points.shape[1] == 0:
            raise EpisodeError(f"{name}: no point of the {what} is left after the filters; look at masks and tracks")
    on_object = on_object[:, farthest_points(on_object[0], options.object_points)]
    on_hand = on_hand[:, farthest_points(on_hand[0], options.controllers)]
    stamps_ns = np.array([stamp_ns for stamp_ns, _ in frames], np.int64)
    return Episode(
        name=name,
        times=(stamps_ns - stamps_ns[0]) * 1e-9,
        points=on_object.astype(np.float32),
        confidence=np.isfinite(on_object).all(axis=2).astype(np.float32),
        point_ids=np.arange(on_object.shape[1], dtype=np.uint32),
        controllers=on_hand.astype(np.float32),
        controller_ids=np.arange(on_hand.shape[1], dtype=np.uint32),
        ground_height=ground_height,
    )


def _queries(mask: np.ndarray, most: int) -> np.ndarray:
    """[N, 2] pixels x, y of a mask on the finest square grid that has at most so many."""
    rows, columns = np.nonzero(mask)
    step = int(np.ceil(np.sqrt(max(len(rows) / most, 1))))
    on_grid = (rows % step == 0) & (columns % step == 0)
    return np.column_stack([columns[on_grid], rows[on_grid]]).astype(float)
