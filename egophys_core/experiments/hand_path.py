"""The path of a hand: where it goes, how it turns, and when it holds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.minimum_jerk import PEAK_SPEED, minimum_jerk
from egophys_core.waypoint_plan import OPEN, POINTING_DOWN, WaypointPlan

STEP_S = 0.05
"""Seconds between waypoints of what moves, at most."""

ABOVE_M = 0.08
"""Metres above its place from which a hand comes."""

ARRIVES_S, CLOSES_S = 1.0, 0.5
"""Seconds until a hand is at its place, and from there until it holds and moves."""


@dataclass(frozen=True, kw_only=True)
class ToolPath:
    """Where one hand goes; straight between waypoints."""

    times: np.ndarray
    """[W] seconds, increasing from 0."""
    positions: np.ndarray
    """[W, 3] metres, world."""
    turns: np.ndarray
    """[W] radians about the vertical from how it came, counter-clockwise from above."""
    holds: np.ndarray
    """[W] bool, whether it holds from this waypoint on."""


class PathWriter:
    """Writes the path of a hand, move after move; begins with a hand that comes from above and closes, or holds."""

    def __init__(self, place: np.ndarray, *, holds: bool = False) -> None:
        """Take hold at a place [3], metres, or hold there from the start."""
        self._place = np.asarray(place, np.float64)
        self._times = [0.0, ARRIVES_S]
        self._offsets = [np.array([0.0, 0.0, 0.0 if holds else ABOVE_M]), np.zeros(3)]
        self._turns = [0.0, 0.0]
        self._holds = [holds, True]
        self.wait(CLOSES_S)

    @property
    def duration(self) -> float:
        """Seconds so far."""
        return self._times[-1]

    def wait(self, seconds: float) -> None:
        """Stay."""
        self._add(self._times[-1] + seconds, self._offsets[-1])

    def move(self, to: Sequence[float] | np.ndarray, *, peak_speed: float) -> None:
        """Go to an offset [3] from where it took hold, with a smooth speed of at most so many m/s."""
        begin, end = self._offsets[-1], np.asarray(to, np.float64)
        distance = float(np.linalg.norm(end - begin))
        if distance == 0.0:
            return
        for time, share in self._smoothly(PEAK_SPEED * distance / peak_speed):
            self._add(time, begin + share * (end - begin))

    def turn(self, to: float, *, peak_rate: float) -> None:
        """Turn on the spot to an angle from how it took hold, radians, by at most so many a second."""
        begin = self._turns[-1]
        for time, share in self._smoothly(PEAK_SPEED * abs(to - begin) / peak_rate):
            self._add(time, self._offsets[-1], turn=begin + share * (to - begin))

    def swing(self, along: np.ndarray, *, amplitude: float, frequency: float, cycles: int) -> None:
        """Swing to and fro about where it is, metres and Hz; it grows in the first cycle and ebbs in the last."""
        middle, started = self._offsets[-1], self._times[-1]
        count = int(np.ceil(cycles / frequency / STEP_S))
        for phase in np.arange(1, count + 1) * cycles / count:
            envelope = min(1.0, phase, cycles - phase)
            self._add(started + phase / frequency, middle + envelope * amplitude * np.sin(2 * np.pi * phase) * along)

    def let_go(self) -> None:
        """Open the hand."""
        self._holds[-1] = False

    def path(self) -> ToolPath:
        """What was written."""
        return ToolPath(
            times=np.array(self._times),
            positions=self._place + np.array(self._offsets),
            turns=np.array(self._turns),
            holds=np.array(self._holds),
        )

    def _smoothly(self, duration: float) -> Iterator[tuple[float, float]]:
        """Times from now on, and the shares of a minimum-jerk move of so many seconds that are done then."""
        duration = max(duration, STEP_S)
        started, count = self._times[-1], int(np.ceil(duration / STEP_S))
        for share in np.arange(1, count + 1) / count:
            yield started + share * duration, float(minimum_jerk(share))

    def _add(self, time: float, offset: np.ndarray, *, turn: float | None = None) -> None:
        self._times.append(float(time))
        self._offsets.append(np.asarray(offset, np.float64))
        self._turns.append(self._turns[-1] if turn is None else float(turn))
        self._holds.append(self._holds[-1])


def plan_of_path(path: ToolPath, twin_id: str) -> WaypointPlan:
    """The path for an arm whose tool points down."""
    about_vertical = Rotation.from_rotvec(path.turns[:, None] * [0.0, 0.0, 1.0])
    return WaypointPlan(
        # Whole nanoseconds, as messages carry them.
        times=np.rint(path.times * 1e9) / 1e9,
        positions=path.positions,
        quaternions=(about_vertical * Rotation.from_quat(POINTING_DOWN)).as_quat(),
        gripper_opening=np.where(path.holds, 0.0, OPEN),
        twin_id=twin_id,
        predicted_cost=float("nan"),
    )
