"""Points of a hand in space: a ball about the place where it holds or pushes, which goes along with it."""

import numpy as np

from egophys_core.perception.camera.parallax import rays_of_pixels
from egophys_core.perception.stages import View

RADIUS_M = 0.027
"""Metres: of the ball, about that of a closed hand's fingers."""


def ball(count: int) -> np.ndarray:
    """[C, 3] metres: points spread evenly in a ball about the origin, the same ones each time."""
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    turn = np.pi * (1 + np.sqrt(5)) * index
    level = np.sqrt(1 - height**2)
    # The golden ratio spreads the shells over the directions as well.
    shell = ((index * (np.sqrt(5) - 1) / 2) % 1.0) ** (1 / 3)
    points = np.column_stack([level * np.cos(turn), level * np.sin(turn), height]) * shell[:, None]
    return np.asarray(RADIUS_M * (points - points.mean(axis=0)))


def at_depth(pixels: np.ndarray, depth: float, view: View) -> np.ndarray:
    """[N, 3] metres, frame world: pixels [N, 2] at a depth along the optical axis."""
    return view.world_from_camera[:3, 3] + depth * rays_of_pixels(pixels, view)
