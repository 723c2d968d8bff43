"""Circular moves: the circle through where the TCP stands and two further points."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from xarm_bridge.emulator.motion import Trapezoid
from xarm_bridge.kinematics import Pose

THINNEST = 1e-6
"""Sine of the angle between the directions to the two points below which they count as on one line with the start."""


@dataclass(frozen=True, slots=True)
class CircleMove:
    """TCP on an arc that passes through two points.

    Orientation turns steadily until the second point is reached and stays from there on. UFACTORY's documentation
    leaves the orientation open; this is a choice of the emulator's.
    """

    start: Pose
    centre: np.ndarray
    """[3] millimetres."""
    arc: np.ndarray
    """[3] whole turn of the TCP about the centre as a rotation vector, radians; its length may exceed a full turn."""
    turn: np.ndarray
    """[3] from the start's to the second point's orientation as a rotation vector in the start's frame."""
    turned_at: float
    """Share of the arc at which the second point is reached; above 1 if the arc ends before it."""
    profile: Trapezoid

    @classmethod
    def through(
        cls, start: Pose, first: Pose, second: Pose, rounds: float, speed: float, acceleration: float
    ) -> "CircleMove | None":
        """The move of so many rounds (above 0), in mm/s and mm/s^2; None if the points are on one line."""
        to_first, to_second = first.position - start.position, second.position - start.position
        normal = np.cross(to_first, to_second)
        lengths = float(np.linalg.norm(to_first) * np.linalg.norm(to_second))
        if np.linalg.norm(normal) <= THINNEST * lengths:
            return None
        # Circumcentre of the triangle, seen from the start (Wikipedia, "Circumcircle", Cartesian coordinates in 3D).
        from_start = np.cross(to_first @ to_first * to_second - to_second @ to_second * to_first, normal) / (
            2 * normal @ normal
        )
        axis = normal / np.linalg.norm(normal)
        radius = float(np.linalg.norm(from_start))
        chord = to_second - from_start
        angle = float(np.arctan2(axis @ np.cross(-from_start, chord), -from_start @ chord)) % (2 * np.pi)
        arc = 2 * np.pi * rounds
        return cls(
            start=start,
            centre=start.position + from_start,
            arc=arc * axis,
            turn=(start.rotation.inv() * second.rotation).as_rotvec(),
            turned_at=angle / arc,
            profile=Trapezoid(arc * radius, speed, acceleration),
        )

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.profile.duration

    def at(self, time: float) -> Pose:
        """TCP pose at a time in seconds."""
        share = self.profile.share_at(time)
        swung = Rotation.from_rotvec(share * self.arc).apply(self.start.position - self.centre)
        turned = share / self.turned_at if share < self.turned_at else 1.0
        rotation = self.start.rotation * Rotation.from_rotvec(turned * self.turn)
        return Pose(self.centre + swung, rotation)
