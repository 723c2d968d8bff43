"""Camera poses of single frames -> one pose per frame, with short gaps filled."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.errors import EpisodeError
from egophys_core.interpolation import PosesOverTime

LONGEST_FILLED_GAP_S = 0.5
"""As for controllers: what a head does in longer than half a second cannot be guessed."""


@dataclass(frozen=True, kw_only=True)
class PoseTrack:
    """The camera over T frames."""

    world_from_camera: np.ndarray
    """[T, 4, 4] float64, metres; NaN where unknown."""
    inferred: np.ndarray
    """[T] bool: interpolated between frames before and after."""
    known: np.ndarray
    """[T] bool: measured or inferred."""


def track_poses(stamps_ns: Sequence[int] | np.ndarray, poses: np.ndarray) -> PoseTrack:
    """Put poses of single frames together and interpolate where they are missing.

    A gap lasts from the pose before it to the pose after it. Gaps up to `LONGEST_FILLED_GAP_S` are filled: places
    linearly, orientations along the shortest turn. Nothing is filled before the first pose or after the last.

    Args:
        stamps_ns: [T] strictly increasing, nanoseconds.
        poses: [T, 4, 4] world from camera, metres; NaN where it is missing.

    Raises:
        EpisodeError: the lengths differ or the stamps do not increase.
    """
    times = np.asarray(stamps_ns, dtype=np.int64)
    if len(times) != len(poses) or (np.diff(times) <= 0).any():
        raise EpisodeError(
            f"poses need one strictly increasing stamp each, got {len(poses)} poses and {len(times)} stamps; "
            "sort the frames by stamp and drop repeated ones"
        )
    matrices = np.array(poses, dtype=np.float64).reshape(-1, 4, 4)
    measured = np.isfinite(matrices).all(axis=(1, 2))
    inferred = np.zeros(len(poses), bool)
    frames = np.flatnonzero(measured)
    seconds = (times - times[:1]) * 1e-9
    for before, after in pairwise(frames):
        if after - before == 1 or seconds[after] - seconds[before] > LONGEST_FILLED_GAP_S:
            continue
        gap = np.arange(before + 1, after)
        ends = matrices[[before, after]]
        poses_between = PosesOverTime(seconds[[before, after]], ends[:, :3, 3], Rotation.from_matrix(ends[:, :3, :3]))
        positions, rotations = poses_between.at(seconds[gap])
        matrices[gap] = np.eye(4)
        matrices[gap, :3, :3] = rotations.as_matrix()
        matrices[gap, :3, 3] = positions
        inferred[gap] = True
    return PoseTrack(world_from_camera=matrices, inferred=inferred, known=measured | inferred)
