"""Whether the object rests at first, and whether the head moves enough to see its depth."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_render import project

_POINTS = 200
_HEIGHTS_M = np.arange(-0.005, 0.3005, 0.0025)
"""Metres over the table: where a resting point may be."""
_FLOW = {"winSize": (17, 17), "maxLevel": 4, "criteria": (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 0.01)}
_RETURNS_PX = 0.6
"""Pixels: a point followed forth and back that misses itself by more was lost."""
_LARGEST_PX = 5.0
"""Pixels: what is farther off counts as this."""
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
    tracks = _tracks(views, mask)
    times = np.array([(view.stamp_ns - views[0].stamp_ns) * 1e-9 for view in views])
    # What sinks or rolls at first rests in a later view, from which the others are then explained.
    anchors = sorted({0, len(views) // 3, 2 * len(views) // 3})
    residuals = [_residual(views, tracks, anchor) for anchor in anchors]
    best = min(residuals, key=lambda each: float(np.nanmedian(each)) if np.isfinite(each).any() else np.inf)
    return Stillness(times=times, residual_px=best, points=int(np.isfinite(tracks[-1, :, 0]).sum()))


def _residual(views: tuple[View, ...], tracks: np.ndarray, anchor: int) -> np.ndarray:
    """[V] pixels, median over the points: where each is beside a place on the ray of its pixel in the anchor view.

    Of the heights on that ray the one counts that explains the whole track best.
    """
    places = _on_ray(views[anchor], tracks[anchor])
    off = np.stack(
        [
            np.linalg.norm(_projected(view, places) - track[:, None], axis=-1)
            for view, track in zip(views, tracks, strict=True)
        ]
    )
    cost = np.where(np.isfinite(off), np.minimum(off, _LARGEST_PX), 0.0).sum(axis=0)
    best = np.take_along_axis(off, cost.argmin(axis=1)[None, :, None], axis=2)[..., 0]
    known = np.isfinite(best)
    return np.array(
        [np.median(row[sure]) if sure.sum() >= _FEWEST else np.nan for row, sure in zip(best, known, strict=True)]
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


def _tracks(views: tuple[View, ...], mask: np.ndarray) -> np.ndarray:
    """[V, N, 2] pixels of points of the object; NaN from where they are lost."""
    grays = [cv2.cvtColor(view.image, cv2.COLOR_BGR2GRAY) for view in views]
    inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8))
    corners = cv2.goodFeaturesToTrack(grays[0], _POINTS, 0.01, 5, mask=inner)
    start = np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)
    tracks = [start.astype(float)]
    for before, now in pairwise(grays):
        last = tracks[-1].astype(np.float32)
        known = np.isfinite(last).all(axis=1)
        moved = np.full_like(last, np.nan)
        if known.any():
            there, found, _ = cv2.calcOpticalFlowPyrLK(before, now, last[known], None, **_FLOW)  # type: ignore[call-overload]
            back, returned, _ = cv2.calcOpticalFlowPyrLK(now, before, there, None, **_FLOW)  # type: ignore[call-overload]
            good = (found.ravel() > 0) & (returned.ravel() > 0)
            good &= np.linalg.norm(back - last[known], axis=1) < _RETURNS_PX
            moved[np.flatnonzero(known)[good]] = there[good]
        tracks.append(moved.astype(float))
    return np.stack(tracks)


def _on_ray(view: View, pixels: np.ndarray) -> np.ndarray:
    """[N, H, 3] metres, world: where the rays of pixels [N, 2] have each of `_HEIGHTS_M`."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(view.camera_matrix).T
    rays = rays @ view.world_from_camera[:3, :3].T
    eye = view.world_from_camera[:3, 3]
    reach = (_HEIGHTS_M[None] - eye[2]) / rays[:, [2]]
    return np.asarray(eye + reach[..., None] * rays[:, None])


def _projected(view: View, places: np.ndarray) -> np.ndarray:
    flat = project(places.reshape(-1, 3), view.camera_matrix, view.world_from_camera)
    return np.asarray(np.where(flat[:, 2:] > 0, flat[:, :2], np.nan).reshape(*places.shape[:2], 2))
