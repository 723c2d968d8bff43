"""The arm without its controller: where it stands, how fast it goes, and where it can be."""

import numpy as np
from scipy.spatial.transform import Rotation

from xarm_bridge.emulator.motion import Place
from xarm_bridge.emulator.reduced import ReducedMode
from xarm_bridge.emulator.states import BOUNDARY_ERROR, JOINT_LIMIT_ERROR, KINEMATIC_ERROR, MotionError
from xarm_bridge.kinematics import JOINTS, READY_JOINTS, Pose, forward, inverse, inverse_near

CONTROL_CYCLE = 0.004
"""Seconds; speeds are measured over at least one (UFACTORY: the control loop runs at 250 Hz)."""


class Mechanics:
    """Joint angles and TCP pose, always of each other and always inside the limits."""

    def __init__(self, start: Pose, limits: ReducedMode) -> None:
        """With the flange at `start`, and no TCP offset.

        Raises:
            ValueError: the arm cannot reach `start`.
        """
        joints = inverse(start, READY_JOINTS)
        if joints is None or limits.joints_outside(joints):
            raise ValueError(f"an xArm6 cannot reach {np.round(start.to_wire(), 3).tolist()} (mm, rad)")
        self.joints = joints
        """[6] radians."""
        self.tool = start
        """TCP pose."""
        self.tcp_offset = Pose(np.zeros(3), Rotation.identity())
        """TCP pose in the flange frame."""
        self.joint_speeds = np.zeros(JOINTS)
        """[6] rad/s."""
        self.tool_speed = 0.0
        """mm/s."""
        self._limits = limits
        self._measured = (0.0, self.joints, self.tool.position)

    def set_tcp_offset(self, offset: Pose) -> None:
        """The arm stands still, its TCP is elsewhere."""
        self.tcp_offset = offset
        self.tool = forward(self.joints) @ offset

    def trouble_at(self, place: Place) -> int:
        """The error code that being at a TCP pose or at joint angles [6] ends with, 0 if none."""
        if isinstance(place, Pose):
            joints = inverse(place @ self.tcp_offset.inverse(), self.joints)
            return KINEMATIC_ERROR if joints is None else self._limit_trouble(place, joints)
        if place is None:
            return 0
        return self._limit_trouble(forward(place) @ self.tcp_offset, place)

    def go(self, place: Place) -> None:
        """Be there next.

        Raises:
            MotionError: a pose that the joints cannot follow to, or outside the limits; the arm stays where it was.
        """
        if place is None:
            return
        if isinstance(place, Pose):
            tool, joints = place, inverse_near(place @ self.tcp_offset.inverse(), self.joints)
            if joints is None:
                raise MotionError(KINEMATIC_ERROR)
        else:
            tool, joints = forward(place) @ self.tcp_offset, place
        if trouble := self._limit_trouble(tool, joints):
            raise MotionError(trouble)
        self.tool, self.joints = tool, joints

    def measure_speeds(self, now: float) -> None:
        """Speeds since the last measurement, if a control cycle has passed."""
        then, joints, position = self._measured
        elapsed = now - then
        if elapsed >= CONTROL_CYCLE:
            self.joint_speeds = (self.joints - joints) / elapsed
            self.tool_speed = float(np.linalg.norm(self.tool.position - position)) / elapsed
            self._measured = (now, self.joints, self.tool.position)

    def _limit_trouble(self, tool: Pose, joints: np.ndarray) -> int:
        if self._limits.joints_outside(joints):
            return JOINT_LIMIT_ERROR
        return BOUNDARY_ERROR if self._limits.tool_outside(tool.position) else 0
