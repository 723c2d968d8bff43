"""Executes waypoint plans on an xArm: frames, limits, the plan's time law, stop, and what really happened."""

import contextlib
import threading
import time
from collections.abc import Callable

import numpy as np

from egophys_core.errors import RobotError
from egophys_core.robot import Calibration, MotionLimits, PlannedPath, StraightMove, Transform, check_plan
from egophys_core.waypoint_plan import WaypointPlan
from xarm_bridge.connection import Connection
from xarm_bridge.executed import ExecutedMotion, Progress, Recorder

# Plans are streamed in servo mode instead of sent as one set_position per waypoint. A soft object swings and
# slides by when the tool is where, and set_position takes a speed, not a time: each line starts and ends at
# rest (or is rounded by a blend radius), so a plan would run late by an amount nobody predicted. Streaming
# poses sampled from the plan's own time law keeps that law to within a period, and a stop is never queued
# behind motion commands.
STREAM_PERIOD = 0.01
"""Seconds; UFACTORY advises 100 to 200 Hz and warns below 30 Hz."""
LONGEST_STEP = 0.02
"""Plan time that may pass between two poses. After a stall of this process the plan goes on late instead of
jumping, which would be a step at full speed."""
CYCLES_PER_SAMPLE = 2
"""Poses are measured at 50 Hz."""
CYCLES_PER_GRIPPER_SAMPLE = 20
"""The gripper sits on a slow serial line that the pose stream must not wait for."""
SETTLE_INTERVAL = 0.1
SETTLE_TIMEOUT = 3.0
SETTLED_TRAVEL_M = 2e-4
"""Standing still: tool and fingers move less than this in a settle interval."""


LARGEST_POSE_STEP_M = 0.01
"""Servo mode does not execute targets farther apart (UFACTORY, Guide to use set_servo_cartesian)."""


class Arm:
    """An xArm that executes plans, one at a time; `stop` may be called from any thread at any time."""

    def __init__(
        self,
        connection: Connection,
        *,
        calibration: Calibration,
        limits: MotionLimits,
        has_gripper: bool = True,
        on_gripper: Callable[[float], None] = lambda opening: None,
    ) -> None:
        """Takes over the connection; `close` closes it. Nothing moves yet.

        Args:
            connection: to the controller.
            calibration: where the robot stands and what it holds.
            limits: of every motion.
            has_gripper: whether the openings of plans are followed.
            on_gripper: called with each opening that the gripper is told to have, metres.

        Raises:
            RobotError: the limits allow poses farther apart than servo mode executes.
        """
        lever = float(np.linalg.norm(calibration.tool.translation))
        speed = limits.max_speed_m_s + limits.max_angular_speed_rad_s * lever
        if speed * LONGEST_STEP > LARGEST_POSE_STEP_M:
            raise RobotError(
                f"max_speed_m_s + max_angular_speed_rad_s * {lever:.3f} m of tool is {speed:.3f} m/s; "
                f"poses are streamed at up to {LARGEST_POSE_STEP_M / LONGEST_STEP:.2f} m/s, lower one"
            )
        self._connection = connection
        self._calibration = calibration
        self._limits = limits
        self._has_gripper = has_gripper
        self._on_gripper = on_gripper
        self._executing = threading.Lock()
        self._stop_requested = threading.Event()

    def close(self) -> None:
        """Disconnect; the arm stays as it is."""
        self._connection.close()

    def tool_pose(self) -> Transform:
        """Measured pose of the tool point in the world."""
        return self._calibration.tool_in_world(self._connection.tcp_pose())

    def stop(self) -> None:
        """Halt the arm now, and end the plan being executed.

        Raises:
            RobotError: the controller did not confirm; use the emergency stop button.
        """
        self._stop_requested.set()
        self._connection.halt()

    def clear_error(self) -> None:
        """Clear the controller's error; the arm stays stopped until the next plan.

        Raises:
            RobotError: the error stayed.
        """
        self._connection.clear_error()

    def error_code(self) -> int:
        """The controller's error code, 0 if none."""
        return self._connection.error_code()

    def execute(
        self,
        plan: WaypointPlan,
        *,
        stop: threading.Event | None = None,
        on_progress: Progress | None = None,
    ) -> ExecutedMotion:
        """Go to the first waypoint in a straight line, then follow the plan in its own time.

        Args:
            plan: poses in the world; checked as a whole before anything moves.
            stop: set it to end the motion; `stop()` sets it too. Give one to make a stop hold that is
                requested before this call has begun.
            on_progress: called at 50 Hz from this thread.

        Raises:
            RobotError: the plan is refused (nothing has moved), or the controller failed (the arm is halted
                if it still listens).
        """
        check_plan(plan, self._limits, self._calibration.world_to_base)
        if not self._executing.acquire(blocking=False):
            raise RobotError("another plan is being executed; stop it or wait for its end")
        try:
            self._stop_requested = stop or threading.Event()
            path = PlannedPath(plan)
            start = self.tool_pose()
            self._check_way(plan, start)
            approach = StraightMove(start, path.pose_at(0.0), self._limits)
            recorder = Recorder(self.tool_pose, self._opening, path.duration, on_progress)
            try:
                return self._run(approach, path, recorder)
            except BaseException:
                with contextlib.suppress(RobotError):
                    self._connection.halt()
                raise
        finally:
            self._executing.release()

    def _run(self, approach: StraightMove, path: PlannedPath, recorder: Recorder) -> ExecutedMotion:
        self._connection.enter_servo_mode()
        if self._has_gripper:
            self._connection.prepare_gripper()
            self._move_gripper(path.opening_at(0.0))
        completed = (
            self._stream(approach.pose_at, approach.duration, lambda clock, cycle: None)
            and self._settle(lambda: None)
            and self._follow(path, recorder)
            and self._settle(recorder.sample)
        )
        if completed:
            self._connection.leave_servo_mode()
        if self._stop_requested.is_set():
            # The stop may have come between two steps of entering or leaving, which let motion run again.
            completed = False
            self._connection.halt()
            recorder.sample()
        return recorder.executed(completed)

    def _check_way(self, plan: WaypointPlan, start: Transform) -> None:
        """The box is convex: from a start inside it, the straight approach stays inside."""
        reason = self._limits.outside(self._calibration.world_to_base.apply(start.translation))
        if reason:
            raise RobotError(
                f"the tool now stands where {reason} (robot base frame); move the arm into the workspace by "
                "hand or from the controller's own interface first"
            )
        for index, (position, quaternion) in enumerate(zip(plan.positions, plan.quaternions, strict=True)):
            tool = Transform.from_quaternion(position, quaternion)
            if not self._connection.reachable(self._calibration.tcp_in_base(tool)):
                raise RobotError(
                    f"waypoint {index} (t={plan.times[index]:.2f} s): the arm cannot reach "
                    f"{np.round(position, 3).tolist()} m (world) with orientation "
                    f"{np.round(quaternion, 3).tolist()}; move it closer or turn the tool"
                )

    def _follow(self, path: PlannedPath, recorder: Recorder) -> bool:
        opening = path.opening_at(0.0)
        recorder.begin()

        def each_cycle(clock: float, cycle: int) -> None:
            nonlocal opening
            wanted = path.opening_at(clock)
            if self._has_gripper and wanted != opening:
                self._move_gripper(wanted)
                opening = wanted
            if cycle % CYCLES_PER_SAMPLE == 0 or clock >= path.duration:
                recorder.sample(clock=clock, gripper=cycle % CYCLES_PER_GRIPPER_SAMPLE == 0)

        return self._stream(path.pose_at, path.duration, each_cycle)

    def _stream(
        self,
        pose_at: Callable[[float], Transform],
        duration: float,
        each_cycle: Callable[[float, int], None],
    ) -> bool:
        """Stream poses until `duration`; False when a stop ended it."""
        clock, cycle = 0.0, 0
        last = time.monotonic()
        while not self._stop_requested.is_set():
            try:
                self._connection.servo_to(self._calibration.tcp_in_base(pose_at(clock)))
            except RobotError:
                if self._stop_requested.is_set():  # the stop came first and the pose was refused
                    break
                raise
            each_cycle(clock, cycle)
            if clock >= duration:
                return True
            cycle += 1
            time.sleep(max(0.0, last + STREAM_PERIOD - time.monotonic()))
            now = time.monotonic()
            clock = min(clock + min(now - last, LONGEST_STEP), duration)
            last = now
        return False

    def _settle(self, sample: Callable[[], None]) -> bool:
        """Wait until tool and fingers stand still (fingers on an object never arrive); False on a stop."""
        deadline = time.monotonic() + SETTLE_TIMEOUT
        before = np.full(4, np.inf)
        while time.monotonic() < deadline and not self._stop_requested.is_set():
            sample()
            now = np.append(self._connection.tcp_pose().translation, np.nan_to_num(self._opening()))
            if np.abs(now - before).max() < SETTLED_TRAVEL_M:
                break
            before = now
            self._stop_requested.wait(SETTLE_INTERVAL)
        return not self._stop_requested.is_set()

    def _move_gripper(self, opening: float) -> None:
        self._connection.move_gripper(opening)
        self._on_gripper(opening)

    def _opening(self) -> float:
        return self._connection.gripper_opening() if self._has_gripper else float("nan")
