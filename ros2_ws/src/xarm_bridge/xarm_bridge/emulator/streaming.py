"""Motion that clients steer as it goes: newest servo targets, and velocities.

Simplification: speed is reached and lost at once, without the ramps of a real arm.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from xarm_bridge.kinematics import Pose

SERVO_LARGEST_STEP = 10.0
"""mm; farther targets are not executed (UFACTORY, Guide to use set_servo_cartesian)."""


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """What the arm is held to."""

    tool: float = 1000.0
    """mm/s; servo targets are run at this, the fastest tool speed (UFACTORY, Servo Mode Usage Guide)."""
    turn: float = np.pi
    """rad/s of the tool, the same guide's 180 degrees per second."""
    joints: float = np.pi
    """rad/s."""


@dataclass(frozen=True, slots=True)
class JointVelocity:
    """Every joint at its speed."""

    speeds: np.ndarray
    """[6] rad/s."""

    def limited(self, limits: SpeedLimits) -> "JointVelocity":
        """All joints slower in proportion, if one is too fast."""
        return JointVelocity(self.speeds * _share(limits.joints, float(np.abs(self.speeds).max())))

    @property
    def is_zero(self) -> bool:
        """Whether it moves nothing."""
        return not self.speeds.any()

    def carry(self, tool: Pose, joints: np.ndarray, elapsed: float) -> np.ndarray:
        """Joint angles [6] after some seconds."""
        return joints + elapsed * self.speeds


@dataclass(frozen=True, slots=True)
class ToolVelocity:
    """The TCP at a speed and a rate of turn, in the base's frame or in its own."""

    linear: np.ndarray
    """[3] mm/s."""
    angular: np.ndarray
    """[3] rad/s about the axes of the frame."""
    in_tool_frame: bool

    def limited(self, limits: SpeedLimits) -> "ToolVelocity":
        """Slower in proportion, if it is too fast."""
        share = min(
            _share(limits.tool, float(np.linalg.norm(self.linear))),
            _share(limits.turn, float(np.linalg.norm(self.angular))),
        )
        return ToolVelocity(share * self.linear, share * self.angular, self.in_tool_frame)

    @property
    def is_zero(self) -> bool:
        """Whether it moves nothing."""
        return not (self.linear.any() or self.angular.any())

    def carry(self, tool: Pose, joints: np.ndarray, elapsed: float) -> Pose:
        """TCP pose after some seconds."""
        step, turn = elapsed * self.linear, Rotation.from_rotvec(elapsed * self.angular)
        if self.in_tool_frame:
            return tool @ Pose(step, turn)
        return Pose(tool.position + step, turn * tool.rotation)


Velocity = JointVelocity | ToolVelocity


def towards_pose(target: Pose, tool: Pose, elapsed: float, limits: SpeedLimits) -> tuple[Pose, bool]:
    """TCP pose some seconds later, as fast as servo mode goes, and whether it is the target."""
    displacement = target.position - tool.position
    turn = (tool.rotation.inv() * target.rotation).as_rotvec()
    needed = max(float(np.linalg.norm(displacement)) / limits.tool, float(np.linalg.norm(turn)) / limits.turn)
    share = _share(elapsed, needed)
    if share == 1.0:
        return target, True
    return Pose(tool.position + share * displacement, tool.rotation * Rotation.from_rotvec(share * turn)), False


def towards_joints(
    target: np.ndarray, joints: np.ndarray, elapsed: float, limits: SpeedLimits
) -> tuple[np.ndarray, bool]:
    """Joint angles [6] some seconds later, as fast as servo mode goes, and whether they are the target."""
    displacement = target - joints
    share = _share(elapsed, float(np.abs(displacement).max()) / limits.joints)
    return joints + share * displacement, share == 1.0


def _share(available: float, needed: float) -> float:
    return 1.0 if needed <= available else available / needed
