"""Frames of records: what was tracked in a frame that is not level, taken into the world and back.

A frame is a homogeneous transform [4, 4]: p_record = R p_world + t.
"""

import numpy as np


def into_world(points: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Recorded points [..., 3], metres, as they are in the world."""
    return np.asarray((points - frame[:3, 3]) @ frame[:3, :3])


def into_world_directions(vectors: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Vectors [K, ..., 3] that `frames` [K, 4, 4] record, m/s or m/s^2, as they are in the world."""
    return np.asarray(np.einsum("kij,k...i->k...j", frames[:, :3, :3], vectors))


def into_record(points: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Points [K, ..., 3] of the world, metres, as each of `frames` [K, 4, 4] records them."""
    turned = into_record_directions(points, frames)
    return turned + frames[:, :3, 3].reshape(len(frames), *(1 for _ in points.shape[1:-1]), 3)


def into_record_directions(vectors: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Velocities [K, ..., 3] likewise, m/s."""
    return np.asarray(np.einsum("kij,k...j->k...i", frames[:, :3, :3], vectors))
