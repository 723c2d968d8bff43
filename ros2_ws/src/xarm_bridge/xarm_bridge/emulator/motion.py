"""Moves of the position mode: trapezoidal velocity along a line in space, in joint angles, or none at all."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from xarm_bridge.kinematics import Pose

PURE_ROTATION = 1e-3
"""Below this length in millimetres a move is a rotation, and its speed is read in degrees per second."""

Place = Pose | np.ndarray | None
"""A TCP pose, joint angles [6] in radians, or nothing: the arm stays where it is."""


class Move(Protocol):
    """A move that was planned from where the arm stood then."""

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""

    def at(self, time: float) -> Place:
        """Where the arm shall be at a time in seconds since the start of the move; later is at the goal."""


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """Travel of `length` from rest to rest with bounded speed and acceleration, all in one unit."""

    length: float
    speed: float
    acceleration: float

    @property
    def duration(self) -> float:
        """Seconds; short travels never reach full speed (triangle)."""
        if self.length * self.acceleration <= self.speed**2:
            return 2 * (self.length / self.acceleration) ** 0.5
        return self.length / self.speed + self.speed / self.acceleration

    def share_at(self, time: float) -> float:
        """Travelled share 0 .. 1 at a time in seconds."""
        duration = self.duration
        if time >= duration:
            return 1.0
        if time > duration / 2:
            return 1.0 - self.share_at(duration - time)
        ramp = min(time, self.speed / self.acceleration)
        return (0.5 * self.acceleration * ramp**2 + self.speed * (time - ramp)) / self.length


@dataclass(frozen=True, slots=True)
class LineMove:
    """TCP on a straight line, orientation turning steadily with it."""

    start: Pose
    goal: Pose
    profile: Trapezoid

    @classmethod
    def between(cls, start: Pose, goal: Pose, speed: float, acceleration: float) -> "LineMove":
        """Speed in mm/s and acceleration in mm/s^2, or degrees for a pure rotation."""
        length = float(np.linalg.norm(goal.position - start.position))
        if length < PURE_ROTATION:
            length = float(np.degrees((start.rotation.inv() * goal.rotation).magnitude()))
        return cls(start, goal, Trapezoid(length, speed, acceleration))

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.profile.duration

    def at(self, time: float) -> Pose:
        """TCP pose at a time in seconds."""
        share = self.profile.share_at(time)
        turn = (self.start.rotation.inv() * self.goal.rotation).as_rotvec()
        return Pose(
            self.start.position + share * (self.goal.position - self.start.position),
            self.start.rotation * Rotation.from_rotvec(share * turn),
        )


@dataclass(frozen=True, slots=True)
class JointMove:
    """All joints start and stop together; the one with the longest way has the given speed."""

    start: np.ndarray
    goal: np.ndarray
    profile: Trapezoid

    @classmethod
    def between(cls, start: np.ndarray, goal: np.ndarray, speed: float, acceleration: float) -> "JointMove":
        """Angles [6] in radians, speed in rad/s, acceleration in rad/s^2."""
        return cls(start, goal, Trapezoid(float(np.abs(goal - start).max()), speed, acceleration))

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.profile.duration

    def at(self, time: float) -> np.ndarray:
        """Joint angles [6] at a time in seconds."""
        return self.start + self.profile.share_at(time) * (self.goal - self.start)


@dataclass(frozen=True, slots=True)
class Dwell:
    """Standing still."""

    duration: float
    """Seconds."""

    def at(self, time: float) -> None:
        """Nowhere else."""
