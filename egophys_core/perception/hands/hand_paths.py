"""Paths of hands in space from how they were seen in each view."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from egophys_core.perception.hands.hand_points import at_depth
from egophys_core.perception.observation import HandSight
from egophys_core.perception.stages import View

STEADY_S = 0.12
"""Seconds: widths come and go from view to view with the outline, hands move more slowly."""

LEARNT_VIEWS = 10
"""Views from contact on in which the width of a hand is learnt."""


def hand_paths(sights: Sequence[Mapping[int, HandSight]], views: Sequence[View]) -> dict[int, np.ndarray]:
    """[T, 3] metres, frame world, by the hand's number, where each holds or pushes; of those that ever have contact.

    The depth follows from the width of the hand, which is known from the contact on. Where a hand is not seen it goes
    straight from where it was last to where it is next.

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
    seen = np.array([frame for frame, sight in enumerate(sights) if sight is not None])
    times = np.array([view.stamp_ns for view in views]) * 1e-9
    touched = [frame for frame in seen if sights[frame].has_contact]
    spread = [sights[frame].depth * sights[frame].radius for frame in touched[:LEARNT_VIEWS]]
    depth = np.array([sights[f].depth if sights[f].has_contact else np.median(spread) / sights[f].radius for f in seen])
    step = float(np.median(np.diff(times[seen]))) if len(seen) > 1 else STEADY_S
    depth = gaussian_filter1d(depth, STEADY_S / step, mode="nearest")
    places = np.array(
        [at_depth(sights[frame].pixel[None], each, views[frame])[0] for frame, each in zip(seen, depth, strict=True)]
    )
    return np.column_stack([np.interp(times, times[seen], places[:, axis]) for axis in range(3)])
