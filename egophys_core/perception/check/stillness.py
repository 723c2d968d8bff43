"""Whether the object rests at first, and whether the head moves enough to see its depth."""

from dataclasses import dataclass

import numpy as np

from egophys_core.perception.check.point_heights import explained, follow
from egophys_core.perception.stages import View

_HEIGHTS_M = np.arange(-0.005, 0.3005, 0.0025)
"""Metres over the table: where a resting point may be."""
_FEWEST = 8


@dataclass(frozen=True, kw_only=True)
class Stillness:
    """The object in the first second."""

    times: np.ndarray
    """[V] seconds from the first view."""
    residual_px: np.ndarray
    """[V] pixels: how far points of the object are, in the median, from where they would be if it rested; NaN where
    too few were followed."""
    points: int
    """Followed to the end."""

    def rests(self, within_px: float) -> tuple[float, float]:
        """When the longest time begins in which it rests, and how long that is, seconds; views not known are passed."""
        known = np.isfinite(self.residual_px)
        times, quiet = self.times[known], self.residual_px[known] <= within_px
        longest, begin = (0.0, 0.0), None
        for index, is_quiet in enumerate(quiet):
            begin = (index if begin is None else begin) if is_quiet else None
            if begin is not None and times[index] - times[begin] > longest[1]:
                longest = (float(times[begin]), float(times[index] - times[begin]))
        return longest


def stillness(views: tuple[View, ...], mask: np.ndarray) -> Stillness:
    """Follow points of the object and try whether places at rest on or over the table explain where they go.

    Args:
        views: of the first second, with poses.
        mask: [S, S] bool, of the object in the first.
    """
    tracks = follow(views, mask)
    times = np.array([(view.stamp_ns - views[0].stamp_ns) * 1e-9 for view in views])
    # What sinks or rolls at first rests in a later view, from which the others are then explained.
    anchors = sorted({0, len(views) // 3, 2 * len(views) // 3})
    residuals = [_residual(views, tracks, anchor) for anchor in anchors]
    best = min(residuals, key=lambda each: float(np.nanmedian(each)) if np.isfinite(each).any() else np.inf)
    return Stillness(times=times, residual_px=best, points=int(np.isfinite(tracks[-1, :, 0]).sum()))


def _residual(views: tuple[View, ...], tracks: np.ndarray, anchor: int) -> np.ndarray:
    """[V] pixels, median over the points: where each is beside a place on the ray of its pixel in the anchor view."""
    off = explained(views, tracks, anchor, _HEIGHTS_M).off_px
    known = np.isfinite(off)
    return np.array(
        [np.median(row[sure]) if sure.sum() >= _FEWEST else np.nan for row, sure in zip(off, known, strict=True)]
    )


def depth_error_m(views: tuple[View, ...], place: np.ndarray, pixel_sigma: float = 0.15) -> tuple[float, float]:
    """Metres: how far the camera moved aside over views, and how uncertain a depth that leaves.

    Args:
        views: of the object at rest, with poses.
        place: [3] metres, world, of the object.
        pixel_sigma: pixels, of a point's place.
    """
    centres = np.array([view.world_from_camera[:3, 3] for view in views])
    distance = float(np.linalg.norm(centres[0] - place))
    towards = (place - centres[0]) / distance
    aside = (centres - centres[0]) - np.outer((centres - centres[0]) @ towards, towards)
    apart = np.linalg.norm(aside[:, None] - aside[None], axis=-1)
    spread = float(np.sqrt((aside - aside.mean(axis=0)).var(axis=0).sum()))
    focal = float(views[0].camera_matrix[0, 0])
    error = distance**2 / focal * pixel_sigma / max(spread, 1e-6) / np.sqrt(len(views))
    return float(apart.max()), error
