"""How far the tool's z axis is from straight down, and where on a turn it is farthest."""

import numpy as np
from scipy.spatial.transform import Rotation

ROUNDING = 1e-12
"""Of a height: on a turn about the vertical the tool is as steep everywhere, but for rounding."""


def tilt_of(rotation: np.ndarray) -> float:
    """Radians between the z axis of a rotation [3, 3] and straight down, 0 to pi."""
    return float(np.arccos(np.clip(-rotation[2, 2], -1.0, 1.0)))


def steepest_between(start: np.ndarray, turn: np.ndarray) -> np.ndarray | None:
    """The rotation [3, 3] on a turn that is tilted more than both of its ends, if there is one, and most of all.

    The z axis goes round the axis of the turn, so its height is a sine of the angle: by Rodrigues' formula
    constant + along cos + across sin, which is greatest at the angle whose tangent is across / along.

    Args:
        start: rotation [3, 3] before the turn.
        turn: [3] rotation vector in the frame of `start`, at most half a round.
    """
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return None
    axis, up = turn / angle, start[2]
    along = up[2] - (up @ axis) * axis[2]
    across = up @ np.cross(axis, [0.0, 0.0, 1.0])
    highest = np.arctan2(across, along)
    if not 0.0 < highest < angle:
        return None
    tipped, end = (start @ Rotation.from_rotvec(each * axis).as_matrix() for each in (highest, angle))
    return tipped if tipped[2, 2] > max(start[2, 2], end[2, 2]) + ROUNDING else None
