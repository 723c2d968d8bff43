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

FASTEST = 1.0
"""Per second: change of a hand's depth over that depth. 13 hands whose paths were measured come to 0.5; what grows
faster has turned its end to the camera, or has been taken together with its arm (docs/notes/hands.md)."""

JUMP_S = 0.13
"""Seconds within which a width jumps."""


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
    widths = median_filter(np.array([sight.radius for sight in known.values()]), OUTLIER_VIEWS, mode="nearest")
    steady = _without_jumps(widths, times[seen], int(np.searchsorted(seen, first)))
    depth = touched.depth * touched.radius * gaussian_filter1d(1 / steady, STEADY_S / step, mode="nearest")
    places = offset + np.array(
        [at_depth(known[frame].pixel[None], each, views[frame])[0] for frame, each in zip(seen, depth, strict=True)]
    )
    if not touched.holds:
        eyes = np.array([views[frame].world_from_camera[:3, 3] for frame in seen])
        places = level_path(places, eyes, float(touched.grip[2]), PUSHING_DRIFT)
    return np.column_stack([np.interp(times, times[seen], places[:, axis]) for axis in range(3)])


def _without_jumps(widths: np.ndarray, times: np.ndarray, first: int) -> np.ndarray:
    """[V] pixels: widths in which jumps are left out, so that the width of view `first` stays."""
    logs = np.log(widths)
    steps = np.diff(logs)
    is_jump = np.zeros(len(steps), bool)
    for begin in range(len(steps)):
        end = int(np.searchsorted(times, times[begin] + JUMP_S, side="right")) - 1
        if abs(logs[end] - logs[begin]) > FASTEST * (times[end] - times[begin]):
            is_jump[begin:end] = True
    along = np.concatenate([[0.0], np.cumsum(np.where(is_jump, 0.0, steps))])
    return np.asarray(np.exp(logs[first] + along - along[first]))
