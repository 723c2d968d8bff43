"""A cable between two hands as a curve: markers and held points on it."""

import numpy as np

from egophys_core.episode import Episode
from tests.discrepancy.cantilever import still_episode

LENGTH = 0.9
"""Metres of the whole curve."""


def curve(count: int, *, half_turn: float = 1.2, length: float = LENGTH) -> np.ndarray:
    """[count, 3] metres: points at equal ways along an arc of a circle that hangs in the x-z plane."""
    radius = length / (2.0 * half_turn)
    angles = np.linspace(-half_turn, half_turn, count)
    return np.stack([radius * np.sin(angles), np.zeros(count), 1.0 - radius * np.cos(angles)], axis=1)


def record_of(points: np.ndarray, *, held_first: int, held_last: int, frames: int = 60) -> Episode:
    """Places [K, 3] that do not move, of which the first and the last few are held."""
    end = len(points) - held_last
    return still_episode(np.concatenate([points[:held_first], points[end:]]), points[held_first:end], frames=frames)
