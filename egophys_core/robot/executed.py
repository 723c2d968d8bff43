"""What the arm really did: measured while a plan runs."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from egophys_core.robot.arm_driver import ArmState
from egophys_core.robot.calibration import Calibration
from egophys_core.robot.frames import Transform
from egophys_core.robot.measured_arm import MeasuredArm
from egophys_core.waypoint_plan import NANOSECONDS

SHARED_S = 0.01
"""A measurement that someone else asked for is as good as one's own for so long."""

Progress = Callable[[float, Transform], None]
"""Called while a plan runs with the share done (0..1) and the measured tool pose in the world."""


@dataclass(frozen=True, kw_only=True)
class ExecutedMotion:
    """What the tool really did while a plan ran, measured by the controller. Frame `world`."""

    start_ns: int
    """When the plan started, nanoseconds since the epoch."""
    times: np.ndarray
    """[S] float64, seconds since the plan started (the approach to its first waypoint is not included)."""
    positions: np.ndarray
    """[S, 3] float64, tool position, metres."""
    quaternions: np.ndarray
    """[S, 4] float64, tool orientation, x y z w."""
    gripper_opening: np.ndarray
    """[S] float64, metres, measured at 5 Hz and held; NaN without a gripper."""
    completed: bool
    """False when a stop ended the motion early."""


class Recorder:
    """Collects measurements from the start of the plan on."""

    def __init__(
        self,
        measured: MeasuredArm,
        measure_opening: Callable[[], float],
        calibration: Calibration,
        duration: float,
        on_progress: Progress | None,
    ) -> None:
        """`duration` is the plan's, in seconds; `measure_opening` gives metres."""
        self._measured = measured
        self._measure_opening = measure_opening
        self._calibration = calibration
        self._duration = duration
        self._on_progress = on_progress
        self._start_ns = time.time_ns()
        self._opening = float("nan")
        self._states: list[ArmState] = []
        self._openings: list[float] = []

    def begin(self) -> None:
        """The plan starts now."""
        self._start_ns = time.time_ns()

    def sample(self, clock: float | None = None, gripper: bool = True) -> None:
        """Measure once; `clock` is the plan time, None when the plan is not running."""
        state = self._measured.state(oldest=SHARED_S if self._states else 0.0)
        if self._on_progress and clock is not None:
            share = min(clock / self._duration, 1.0) if self._duration > 0 else 1.0
            self._on_progress(share, self._calibration.tool_in_world(state.tcp))
        if self._states and state.stamp_ns == self._states[-1].stamp_ns:
            return
        if gripper:
            self._opening = self._measure_opening()
        self._states.append(state)
        self._openings.append(self._opening)

    def executed(self, completed: bool) -> ExecutedMotion:
        """Everything measured so far."""
        poses = [self._calibration.tool_in_world(state.tcp) for state in self._states]
        stamps = np.array([state.stamp_ns for state in self._states], np.int64)
        return ExecutedMotion(
            start_ns=self._start_ns,
            times=(stamps - self._start_ns) / NANOSECONDS,
            positions=np.array([pose.translation for pose in poses]).reshape(-1, 3),
            quaternions=np.array([pose.quaternion for pose in poses]).reshape(-1, 4),
            gripper_opening=np.array(self._openings),
            completed=completed,
        )
