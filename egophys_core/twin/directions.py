"""Directions beside a given one, alike for all that point the same way."""

import numpy as np

STEEP = 0.9
"""Height of a unit vector from which on it points up rather than along."""


def level_axes(direction: np.ndarray) -> np.ndarray:
    """[3, 3] axes as rows: one along a direction [3], one level, to its left, and the one across both."""
    along = direction / np.linalg.norm(direction)
    up = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < STEEP else np.array([1.0, 0.0, 0.0])
    level = np.cross(up, along)
    level /= np.linalg.norm(level)
    return np.stack([along, level, np.cross(along, level)])
