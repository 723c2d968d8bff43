"""Points followed over views, and at which heights over the table they would rest."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_render import project

_POINTS = 200
_FLOW = {"winSize": (17, 17), "maxLevel": 4, "criteria": (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 0.01)}
_RETURNS_PX = 0.6
"""Pixels: a point followed forth and back that misses itself by more was lost."""
_LARGEST_PX = 5.0
"""Pixels: what is farther off counts as this."""


@dataclass(frozen=True, kw_only=True)
class Explained:
    """Points as if each rested at one place."""

    off_px: np.ndarray
    """[V, N] pixels beside where that place is seen; NaN where a point was not followed."""
    places: np.ndarray
    """[N, 3] metres, world; NaN where a point was not seen in the anchor view."""


def explained(views: tuple[View, ...], tracks: np.ndarray, anchor: int, heights_m: np.ndarray) -> Explained:
    """Give each point the height, on the ray of its pixel in one view, that explains its whole track best.

    Args:
        views: with poses.
        tracks: [V, N, 2] pixels (`follow`).
        anchor: index of the view whose rays count.
        heights_m: [H] metres over the table, those that are tried.
    """
    places = _on_ray(views[anchor], tracks[anchor], heights_m)
    off = np.stack(
        [
            np.linalg.norm(_projected(view, places) - track[:, None], axis=-1)
            for view, track in zip(views, tracks, strict=True)
        ]
    )
    cost = np.where(np.isfinite(off), np.minimum(off, _LARGEST_PX), 0.0).sum(axis=0)
    best = cost.argmin(axis=1)
    return Explained(
        off_px=np.take_along_axis(off, best[None, :, None], axis=2)[..., 0],
        places=np.take_along_axis(places, best[:, None, None], axis=1)[:, 0],
    )


def follow(views: tuple[View, ...], mask: np.ndarray) -> np.ndarray:
    """[V, N, 2] pixels of points in a mask [S, S] bool of the first view; NaN from where they are lost."""
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


def _on_ray(view: View, pixels: np.ndarray, heights_m: np.ndarray) -> np.ndarray:
    """[N, H, 3] metres, world: where the rays of pixels [N, 2] have each of the heights."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(view.camera_matrix).T
    rays = rays @ view.world_from_camera[:3, :3].T
    eye = view.world_from_camera[:3, 3]
    reach = (heights_m[None] - eye[2]) / rays[:, [2]]
    return np.asarray(eye + reach[..., None] * rays[:, None])


def _projected(view: View, places: np.ndarray) -> np.ndarray:
    flat = project(places.reshape(-1, 3), view.camera_matrix, view.world_from_camera)
    return np.asarray(np.where(flat[:, 2:] > 0, flat[:, :2], np.nan).reshape(*places.shape[:2], 2))
