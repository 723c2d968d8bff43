"""Where the tool should be at a time: along a plan, or on the way to its first waypoint."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.interpolation import PosesOverTime
from egophys_core.minimum_jerk import PEAK_ACCELERATION, PEAK_SPEED, minimum_jerk
from egophys_core.robot.frames import Transform
from egophys_core.robot.limits import MotionLimits
from egophys_core.waypoint_plan import WaypointPlan

RADIANS_PER_METRE = 5.0
"""How much of a turn counts as a metre of the way."""


def poses_between(pose_at: Callable[[float], Transform], first: float, last: float, spacing: float) -> list[Transform]:
    """Poses on a straight, steadily turning way, the end among them and the start not.

    Args:
        pose_at: pose at a time in seconds.
        first: time of the start.
        last: time of the end.
        spacing: largest distance of two poses, metres; turns count by `RADIANS_PER_METRE`.
    """
    start, end = pose_at(first), pose_at(last)
    turn = Rotation.from_matrix(start.rotation.T @ end.rotation).magnitude()
    length = max(float(np.linalg.norm(end.translation - start.translation)), float(turn) / RADIANS_PER_METRE)
    return [pose_at(float(time)) for time in np.linspace(first, last, 2 + int(length / spacing))[1:]]


class PlannedPath:
    """A plan as a function of time: positions linear, orientations slerp, gripper held. Frame of the plan."""

    def __init__(self, plan: WaypointPlan) -> None:
        self._plan = plan
        self._poses = PosesOverTime(plan.times, plan.positions, Rotation.from_quat(plan.quaternions))

    @property
    def duration(self) -> float:
        """Time of the last waypoint, seconds."""
        return float(self._plan.times[-1])

    def pose_at(self, time: float) -> Transform:
        """Tool pose at a time in seconds; the first or last waypoint's outside the plan."""
        position, rotation = self._poses.at(time)
        return Transform(rotation=rotation.as_matrix(), translation=position)

    def opening_at(self, time: float) -> float:
        """Gripper opening in metres: that of the last waypoint passed."""
        index = int(np.searchsorted(self._plan.times, time, side="right")) - 1
        return float(self._plan.gripper_opening[max(index, 0)])


class StraightMove:
    """Straight line from rest to rest with the minimum-jerk time law, as fast as the limits allow."""

    def __init__(self, start: Transform, goal: Transform, limits: MotionLimits) -> None:
        self._start = start
        self._displacement = goal.translation - start.translation
        self.turn = Rotation.from_matrix(start.rotation.T @ goal.rotation).as_rotvec()
        """[3] rotation vector in the frame of the start."""
        length, angle = float(np.linalg.norm(self._displacement)), float(np.linalg.norm(self.turn))
        self.duration = max(
            PEAK_SPEED * length / limits.max_speed_m_s,
            PEAK_SPEED * angle / limits.max_angular_speed_rad_s,
            float(np.sqrt(PEAK_ACCELERATION * length / limits.max_acceleration_m_s2)),
        )
        """Seconds; 0 when start and goal are the same."""

    def pose_at(self, time: float) -> Transform:
        """Pose at a time in seconds, clamped to the move."""
        tau = min(max(time / self.duration, 0.0), 1.0) if self.duration > 0 else 1.0
        share = minimum_jerk(tau)
        return Transform(
            rotation=self._start.rotation @ Rotation.from_rotvec(share * self.turn).as_matrix(),
            translation=self._start.translation + share * self._displacement,
        )
