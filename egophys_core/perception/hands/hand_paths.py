"""Paths of hands in space from how they were seen in each view."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from egophys_core.perception.hands.hand_points import at_depth
from egophys_core.perception.hands.level_paths import PUSHING_DRIFT, level_path
from egophys_core.perception.observation import HandSight
from egophys_core.perception.stages import View

STEADY_S = 0.05
"""Seconds: widths come and go a little from view to view, hands move more slowly."""

OUTLIER_VIEWS = 5
"""Views of a median of the widths."""


def hand_paths(sights: Sequence[Mapping[int, HandSight]], views: Sequence[View]) -> dict[int, np.ndarray]:
    """[T, 3] metres, frame world, by the hand's number, where each holds or pushes; of those that ever have contact.

    Where a hand is not seen it goes straight from where it was last to where it is next.

    Args:
        sights: T views.
        views: T, with poses; their images are not used.
    """
    return {number: _path([seen.get(number) for seen in sights], views) for number in contact_views(sights)}


def contact_views(sights: Sequence[Mapping[int, HandSight]]) -> dict[int, int]:
    """The first view in which each hand has contact, by the hand's number; of those that ever have."""
    found: dict[int, int] = {}
    for view, seen in enumerate(sights):
        for number, sight in seen.items():
            if sight.has_contact:
                found.setdefault(number, view)
    return dict(sorted(found.items()))


def _path(sights: Sequence[HandSight | None], views: Sequence[View]) -> np.ndarray:
    known = {frame: sight for frame, sight in enumerate(sights) if sight is not None}
    first = next(frame for frame, sight in known.items() if sight.has_contact)
    touched = known[first]
    offset = touched.grip - at_depth(touched.pixel[None], touched.depth, views[first])[0]
    seen, times = np.array(list(known)), np.array([view.stamp_ns for view in views]) * 1e-9
    step = float(np.median(np.diff(times[seen]))) if len(seen) > 1 else STEADY_S
    inverse = median_filter(np.array([1 / sight.radius for sight in known.values()]), OUTLIER_VIEWS, mode="nearest")
    depth = touched.depth * touched.radius * gaussian_filter1d(inverse, STEADY_S / step, mode="nearest")
    places = offset + np.array(
        [at_depth(known[frame].pixel[None], each, views[frame])[0] for frame, each in zip(seen, depth, strict=True)]
    )
    if not touched.holds:
        eyes = np.array([views[frame].world_from_camera[:3, 3] for frame in seen])
        places = level_path(places, eyes, float(touched.grip[2]), PUSHING_DRIFT)
    return np.column_stack([np.interp(times, times[seen], places[:, axis]) for axis in range(3)])
