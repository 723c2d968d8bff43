"""Reduced mode and safety boundary: narrower limits that users set for the arm.

As on the control box, what is set counts from the next time the mode is switched on. Simplifications: the joint speed
limit holds for joint moves, joint servo targets and joint velocities, not for what a line asks of single joints; and
the boundary counts in reduced mode too, not only while the safety boundary ("fence") is on.
"""

import struct
from dataclasses import dataclass, replace

import numpy as np

from xarm_bridge.emulator.protocol import pack_floats
from xarm_bridge.emulator.streaming import SpeedLimits
from xarm_bridge.kinematics import JOINT_LIMITS

WIRE_JOINTS = 7
FULL_SPEED = SpeedLimits()


@dataclass(frozen=True, kw_only=True)
class ReducedSettings:
    """What users set; the defaults limit nothing."""

    boundary: tuple[int, ...] = (9999, -9999, 9999, -9999, 9999, -9999)
    """TCP position: largest and smallest x, y, z, mm."""
    tool_speed: float = FULL_SPEED.tool
    """mm/s."""
    joint_speed: float = FULL_SPEED.joints
    """rad/s."""
    joint_ranges: tuple[float, ...] = (-2 * np.pi, 2 * np.pi) * WIRE_JOINTS
    """Smallest and largest angle of each joint, radians."""


class ReducedMode:
    """The settings, and those in force."""

    def __init__(self) -> None:
        self.settings = ReducedSettings()
        self._reduced: ReducedSettings | None = None
        self._fenced: ReducedSettings | None = None

    @property
    def is_on(self) -> bool:
        """Whether reduced mode is on."""
        return self._reduced is not None

    @property
    def fence_is_on(self) -> bool:
        """Whether the safety boundary is on."""
        return self._fenced is not None

    def switch(self, on: bool) -> None:
        """Put the settings in force, or nothing."""
        self._reduced = self.settings if on else None

    def switch_fence(self, on: bool) -> None:
        """Put the boundary in force, or none."""
        self._fenced = self.settings if on else None

    def encode(self) -> bytes:
        """Boundary, speeds and joint ranges as registers and reports carry them."""
        settings = self.settings
        return struct.pack(">6h", *settings.boundary) + pack_floats(
            [settings.tool_speed, settings.joint_speed, *settings.joint_ranges]
        )

    @property
    def speeds(self) -> SpeedLimits:
        """The speeds that hold now."""
        if self._reduced is None:
            return FULL_SPEED
        return replace(
            FULL_SPEED,
            tool=min(FULL_SPEED.tool, self._reduced.tool_speed),
            joints=min(FULL_SPEED.joints, self._reduced.joint_speed),
        )

    def joints_outside(self, joints: np.ndarray) -> bool:
        """Whether any joint [6] is outside the arm's range or the one that holds now."""
        low, high = JOINT_LIMITS.T
        if self._reduced is not None:
            ranges = np.array(self._reduced.joint_ranges[: 2 * len(joints)]).reshape(-1, 2)
            low, high = np.maximum(low, ranges[:, 0]), np.minimum(high, ranges[:, 1])
        return bool(np.any(joints < low) or np.any(joints > high))

    def tool_outside(self, position: np.ndarray) -> bool:
        """Whether a TCP position [3] in mm is outside a boundary that holds now."""
        for settings in (self._reduced, self._fenced):
            if settings is not None:
                high, low = np.array(settings.boundary).reshape(3, 2).T
                if np.any(position < low) or np.any(position > high):
                    return True
        return False
