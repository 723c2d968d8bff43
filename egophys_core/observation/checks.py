"""What an episode must have before anything is fitted to it or compared with it."""

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError

SMALLEST_OBJECT_M, LARGEST_OBJECT_M = 0.01, 5.0
"""Metres across: what hands handle on a table lies well between, in millimetres or kilometres it does not."""


def require_fittable(episode: Episode) -> None:
    """Check that something can move the object, and that its size is one in metres.

    Raises:
        EpisodeError: no controllers, or the points are in another unit.
    """
    if episode.controllers.shape[1] == 0:
        raise EpisodeError(
            f"{episode.name}: no controller points, so nothing moves the object; record the points of the hands, or of "
            "a clamp"
        )
    size = object_size(episode)
    if not SMALLEST_OBJECT_M <= size <= LARGEST_OBJECT_M:
        too_large = "divide millimetres by 1000, centimetres by 100"
        remedy = too_large if size > LARGEST_OBJECT_M else "if they were divided by 1000 twice, do it once"
        raise EpisodeError(
            f"{episode.name}: the object is {size:.3g} m across, a twin is built of objects of {SMALLEST_OBJECT_M:g} "
            f".. {LARGEST_OBJECT_M:g} m; points must be in metres: {remedy}"
        )


def object_size(episode: Episode) -> float:
    """Metres: diagonal of the box around the visible points, median over the frames that have any."""
    points = episode.points[episode.visible.any(axis=1)]
    return float(np.median(np.linalg.norm(np.nanmax(points, axis=1) - np.nanmin(points, axis=1), axis=1)))
