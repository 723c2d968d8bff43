"""Points of the hand in space: its pixels near the grip, at the depth of what it holds.

A hand has no texture to see its depth by, but where it holds the object the two touch: its middle is half its thickness
nearer, and a finger or a fist is about as thick as it is wide.
"""

import numpy as np

from egophys_core.geometry import farthest_points
from egophys_core.perception.camera.parallax import rays_of_pixels
from egophys_core.perception.hands.grip import carried
from egophys_core.perception.stages import Masks, View
from egophys_core.perception.surface.surface_tracker import SurfaceState

RADIUS_M = 0.025
"""Metres around the grip from which points of the hand are taken."""


class HandPoints:
    """Points of one hand from view to view, from the moment it takes hold."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._pixels: np.ndarray | None = None
        self._half_px = np.nan

    def next(self, view: View, masks: Masks, state: SurfaceState) -> np.ndarray:
        """[C, 3] metres, frame world: NaN before the grip and while the hand is not seen.

        Args:
            view: its pose is known.
            masks: of the view.
            state: of the object's surface and of the grip.
        """
        nothing = np.full((self._count, 3), np.nan)
        if self._pixels is None:
            if state.grip is None:
                return nothing
            self._pixels = _pixels_near(state.grip.pixels, masks.hand, state.hand_depth, view, self._count)
        elif state.hand_motion is None:
            return nothing
        else:
            self._pixels = carried(self._pixels, state.hand_motion)
        if np.isfinite(state.hand_width):
            # Pixels spread evenly over a width have its half, over the square root of three, as deviation.
            self._half_px = np.sqrt(3) * state.hand_width
        half = np.nan_to_num(self._half_px) * state.hand_depth / view.camera_matrix[0, 0]
        return at_depth(self._pixels, state.hand_depth - half, view)


def at_depth(pixels: np.ndarray, depth: float, view: View) -> np.ndarray:
    """[N, 3] metres, frame world: pixels [N, 2] at a depth along the optical axis."""
    return view.world_from_camera[:3, 3] + depth * rays_of_pixels(pixels, view)


def _pixels_near(held: np.ndarray, hand: np.ndarray, depth: float, view: View, count: int) -> np.ndarray:
    """[C, 2] pixels of the hand around what it holds, spread evenly; repeated where there are too few."""
    rows, columns = np.nonzero(hand)
    pixels = np.column_stack([columns, rows]).astype(float)
    away = np.linalg.norm(pixels - held.mean(axis=0), axis=1) * depth / view.camera_matrix[0, 0]
    near = pixels[away < RADIUS_M] if (away < RADIUS_M).any() else held
    flat = np.column_stack([near, np.zeros(len(near))])
    chosen = near[farthest_points(flat, count)]
    return np.resize(chosen, (count, 2))
