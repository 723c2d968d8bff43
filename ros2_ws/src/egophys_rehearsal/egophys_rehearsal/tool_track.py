"""Where the tool was, and whether its gripper was closed. Imports no ROS."""

from bisect import bisect_left, bisect_right

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.interpolation import PosesOverTime
from egophys_core.waypoint_plan import NANOSECONDS

STILL_M, STILL_RAD = 1e-3, 1e-2
"""A tool that stays within this has not moved."""


class ToolTrack:
    """Measured poses and commanded openings by the time of measurement and command, nanoseconds since the epoch."""

    def __init__(self, *, closed_below: float) -> None:
        """Know nothing yet; a gripper opened less than `closed_below` metres is closed."""
        self._closed_below = closed_below
        self._stamps: list[int] = []
        self._positions: list[np.ndarray] = []
        self._quaternions: list[np.ndarray] = []
        self._commands: list[int] = []
        self._openings: list[float] = []

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose."""
        return self._stamps[-1] if self._stamps else None

    def add_pose(self, stamp_ns: int, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Add a pose: [3] metres, [4] x y z w; one that is no newer than the last, or is no pose, is dropped."""
        is_pose = np.isfinite([*position, *quaternion]).all() and np.any(quaternion)
        if is_pose and (not self._stamps or stamp_ns > self._stamps[-1]):
            self._stamps.append(stamp_ns)
            self._positions.append(np.asarray(position, float))
            self._quaternions.append(np.asarray(quaternion, float) / np.linalg.norm(quaternion))

    def add_opening(self, stamp_ns: int, opening: float) -> None:
        """Add an opening, metres, that was commanded."""
        self._commands.append(stamp_ns)
        self._openings.append(opening)

    def open(self) -> None:
        """Take the gripper for open until it is told otherwise."""
        self._commands, self._openings = [], []

    def forget_before(self, stamp_ns: int) -> None:
        """Drop what is not needed for times from a stamp on."""
        poses = max(0, bisect_right(self._stamps, stamp_ns) - 1)
        del self._stamps[:poses], self._positions[:poses], self._quaternions[:poses]
        commands = max(0, bisect_right(self._commands, stamp_ns) - 1)
        del self._commands[:commands], self._openings[:commands]

    def points_at(self, stamp_ns: int, cloud: np.ndarray) -> np.ndarray:
        """[C, 3] metres, world: points [C, 3] in the tool frame at a time; before the first pose as at it."""
        after = bisect_left(self._stamps, stamp_ns)
        around = slice(max(after - 1, 0), after + 1)
        seconds = np.array([stamp - stamp_ns for stamp in self._stamps[around]]) / NANOSECONDS
        rotations = Rotation.from_quat(np.array(self._quaternions[around]))
        position, rotation = PosesOverTime(seconds, np.array(self._positions[around]), rotations).at(0.0)
        return np.asarray(rotation.apply(cloud) + position)

    def is_closed(self, stamp_ns: int) -> bool:
        """Whether the gripper was told to close."""
        last = bisect_right(self._commands, stamp_ns) - 1
        return last >= 0 and self._openings[last] < self._closed_below

    def still_until(self, stamp_ns: int, *, since_ns: int) -> int:
        """The time until which nothing has happened, neither since `since_ns` nor after `stamp_ns`.

        Returns:
            At least `stamp_ns`, at most the newest pose.
        """
        begin = max(0, bisect_right(self._stamps, since_ns) - 1)
        positions, quaternions = (np.array(each[begin:]) for each in (self._positions, self._quaternions))
        moved = np.linalg.norm(positions - positions[0], axis=1)
        turned = 2.0 * np.arccos(np.minimum(np.abs(quaternions @ quaternions[0]), 1.0))
        still = np.logical_and.accumulate((moved <= STILL_M) & (turned <= STILL_RAD))
        until = self._stamps[begin + int(still.sum()) - 1]
        commands = [each for each in self._commands if each > since_ns]
        return max(stamp_ns, min([until, *commands]))
