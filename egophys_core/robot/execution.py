"""Executes waypoint plans on an arm: frames, limits, the plan's time law, stop, and what really happened."""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from egophys_core.errors import RobotError
from egophys_core.robot.arm_driver import ArmDriver
from egophys_core.robot.calibration import Calibration
from egophys_core.robot.even_timing import keep_timing_even
from egophys_core.robot.executed import ExecutedMotion, Progress, Recorder
from egophys_core.robot.frames import Transform
from egophys_core.robot.limits import MEASURED_SLACK, MotionLimits, check_plan
from egophys_core.robot.measured_arm import MeasuredArm
from egophys_core.robot.path import PlannedPath, StraightMove, poses_between
from egophys_core.robot.stream_guard import StreamGuard
from egophys_core.robot.tilt import steepest_between
from egophys_core.waypoint_plan import WaypointPlan

# Plans are streamed in servo mode instead of sent as one set_position per waypoint. A soft object swings and
# slides by when the tool is where, and set_position takes a speed, not a time: each line starts and ends at
# rest (or is rounded by a blend radius), so a plan would run late by an amount nobody predicted. Streaming
# poses sampled from the plan's own time law keeps that law to within a period, and a stop is never queued
# behind motion commands.
LONGEST_STEP = 0.02
"""Plan time that may pass between two poses. After a stall of this process the plan goes on late instead of
jumping, which would be a step at full speed."""
CYCLES_PER_SAMPLE = 2
"""Poses are measured at 50 Hz."""
CYCLES_PER_GRIPPER_SAMPLE = 20
"""The gripper sits on a slow serial line that the pose stream must not wait for."""
LONGEST_STALL = 1.0
"""Seconds after which a plan does not go on: what it handles has moved on without it."""
SETTLE_INTERVAL = 0.1
SETTLE_TIMEOUT = 3.0
SETTLED_TRAVEL_M = 2e-4
"""Standing still: tool and fingers move less than this in a settle interval."""


REACH_SPACING_M = 0.005
"""Along the path the arm is asked whether it can follow poses at most this far apart."""
PACE_TOLERANCE = 1.25
"""How much farther apart than the limits allow in `LONGEST_STEP` two streamed poses may be."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Time as the executor sees it; another one makes a rehearsal faster than life."""

    now: Callable[[], float] = time.monotonic
    """Seconds."""
    sleep: Callable[[float], None] = time.sleep


class PlanExecutor:
    """Executes plans on an arm, one at a time; `stop` may be called from any thread at any time."""

    def __init__(
        self,
        driver: ArmDriver,
        *,
        calibration: Calibration,
        limits: MotionLimits,
        has_gripper: bool = True,
        on_gripper: Callable[[float], None] = lambda opening: None,
        require_permit: Callable[[], None] = lambda: None,
        clock: Clock = Clock(),
    ) -> None:
        """Nothing moves yet.

        Args:
            driver: connected to the arm.
            calibration: where the robot stands and what it holds.
            limits: of every motion.
            has_gripper: whether the openings of plans are followed.
            on_gripper: called with each opening that the gripper is told to have, metres.
            require_permit: called before each pose that is streamed; raises RobotError where the arm must not be moved
                any more (`Ownership.require`).
            clock: the time that plans are executed in.

        Raises:
            RobotError: the limits allow poses farther apart than the arm follows.
        """
        lever = float(np.linalg.norm(calibration.tool.translation))
        speed = limits.max_speed_m_s + limits.max_angular_speed_rad_s * lever
        if speed * LONGEST_STEP > driver.largest_pose_step:
            raise RobotError(
                f"max_speed_m_s + max_angular_speed_rad_s * {lever:.3f} m of tool is {speed:.3f} m/s; "
                f"poses are streamed at up to {driver.largest_pose_step / LONGEST_STEP:.2f} m/s, lower one"
            )
        self.measured = MeasuredArm(driver)
        self.longest_gap = 0.0
        """Seconds between two streamed poses, the longest of the newest plan."""
        self._driver = driver
        self._calibration = calibration
        self._limits = limits
        self._has_gripper = has_gripper
        self._on_gripper = on_gripper
        self._require_permit = require_permit
        self._clock = clock
        self._executing = threading.Lock()
        self._stop_requested = threading.Event()

    def tool_pose(self) -> Transform:
        """Measured pose of the tool point in the world."""
        return self._calibration.tool_in_world(self.measured.state(oldest=0.0).tcp)

    def stop(self) -> None:
        """Halt the arm now, and end the plan being executed.

        Raises:
            RobotError: the controller did not confirm; use the emergency stop button.
        """
        self._stop_requested.set()
        self._driver.halt()

    def check(self, plan: WaypointPlan) -> None:
        """Judge a plan as a whole, from where the tool stands now; nothing moves.

        Raises:
            RobotError: names the waypoint, its value, the limit and what to do.
        """
        check_plan(plan, self._limits, self._calibration.world_to_base)
        start = self.tool_pose()
        path = PlannedPath(plan)
        goal = path.pose_at(0.0)
        approach = StraightMove(start, goal, self._limits)
        self._check_approach(start, goal, approach.turn)
        names = [f"waypoint {index} (t={time_s:.2f} s)" for index, time_s in enumerate(plan.times)]
        ways = [(f"on the way to {names[0]}", poses_between(approach.pose_at, 0.0, approach.duration, REACH_SPACING_M))]
        for name, (first, last) in zip(names[1:], pairwise(plan.times.tolist()), strict=True):
            ways.append((f"on the way to {name}", poses_between(path.pose_at, first, last, REACH_SPACING_M)))
        self._check_reach(ways)

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
                if it still listens); ArmLostError and ArmFaultError tell these apart.
        """
        if not self._executing.acquire(blocking=False):
            raise RobotError("another plan is being executed; stop it or wait for its end")
        try:
            self._stop_requested = stop or threading.Event()
            self.check(plan)
            path = PlannedPath(plan)
            approach = StraightMove(self.tool_pose(), path.pose_at(0.0), self._limits)
            recorder = Recorder(self.measured, self._opening, self._calibration, path.duration, on_progress)
            try:
                return self._run(approach, path, recorder)
            except BaseException:
                with contextlib.suppress(RobotError):
                    self._driver.halt()
                raise
        finally:
            self._executing.release()

    def _run(self, approach: StraightMove, path: PlannedPath, recorder: Recorder) -> ExecutedMotion:
        keep_timing_even()
        self.longest_gap = 0.0
        self._driver.begin_streaming()
        if self._has_gripper:
            self._driver.prepare_gripper()
            self._move_gripper(path.opening_at(0.0))
        completed = (
            self._stream(approach.pose_at, approach.duration, lambda clock, cycle: None)
            and self._settle(lambda: None)
            and self._follow(path, recorder)
            and self._settle(recorder.sample)
        )
        if completed:
            self._driver.end_streaming()
        if self._stop_requested.is_set():
            # The stop may have come between two steps of entering or leaving, which let motion run again.
            completed = False
            self._driver.halt()
            recorder.sample()
        return recorder.executed(completed)

    def _check_approach(self, start: Transform, goal: Transform, turn: np.ndarray) -> None:
        """The box is convex: from a start inside it, the straight way stays inside; the tool may be tilted on it."""
        if reason := self._limits.why_not(start, self._calibration.world_to_base, slack=MEASURED_SLACK):
            raise RobotError(
                f"the tool now stands where {reason}; move the arm to an allowed pose by hand or from the controller's "
                "own interface first"
            )
        tipped = steepest_between(start.rotation, turn)
        if tipped is not None and (
            reason := self._limits.why_not(replace(goal, rotation=tipped), self._calibration.world_to_base)
        ):
            raise RobotError(f"on the way to waypoint 0: {reason}; turn the tool nearer to that waypoint's first")

    def _check_reach(self, ways: list[tuple[str, list[Transform]]]) -> None:
        """Whether the arm can follow all ways, one after the other, which are called by their names."""
        tools = [(name, tool) for name, way in ways for tool in way]
        found = self._driver.first_unreachable([self._calibration.tcp_in_base(tool) for _, tool in tools])
        if found is not None:
            name, tool = tools[found]
            raise RobotError(
                f"{name}: the arm cannot reach {np.round(tool.translation, 3).tolist()} m (world) with orientation "
                f"{np.round(tool.quaternion, 3).tolist()}; move it closer or turn the tool"
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
        step = self._limits.max_speed_m_s * LONGEST_STEP * PACE_TOLERANCE
        guard = StreamGuard(self._limits, self._calibration.world_to_base, pose_at(0.0), step)
        clock, cycle = 0.0, 0
        last = self._clock.now()
        while not self._stop_requested.is_set():
            pose = pose_at(clock)
            guard.check(pose)
            self._require_permit()
            target = self._calibration.tcp_in_base(pose)
            # After a stall not even the pose that was next: what it handles has moved on.
            self._gap_since(last)
            try:
                self._driver.stream(target)
            except RobotError:
                if self._stop_requested.is_set():  # the stop came first and the pose was refused
                    break
                raise
            each_cycle(clock, cycle)
            if clock >= duration:
                return True
            cycle += 1
            self._clock.sleep(max(0.0, last + self._driver.stream_period - self._clock.now()))
            gap = self._gap_since(last)
            self.longest_gap = max(self.longest_gap, gap)
            clock = min(clock + min(gap, LONGEST_STEP), duration)
            last += gap
        return False

    def _gap_since(self, last: float) -> float:
        """Seconds since the last pose was due; an error where the plan must not go on after them."""
        gap = self._clock.now() - last
        if gap > LONGEST_STALL:
            raise RobotError(
                f"this machine held the stream of poses up for {gap:.1f} s; the arm was halted, plan again"
            )
        return gap

    def _settle(self, sample: Callable[[], None]) -> bool:
        """Wait until tool and fingers stand still (fingers on an object never arrive); False on a stop."""
        deadline = self._clock.now() + SETTLE_TIMEOUT
        before = np.full(4, np.inf)
        while self._clock.now() < deadline and not self._stop_requested.is_set():
            sample()
            now = np.append(self.tool_pose().translation, np.nan_to_num(self._opening()))
            if np.abs(now - before).max() < SETTLED_TRAVEL_M:
                break
            before = now
            self._clock.sleep(SETTLE_INTERVAL)
        return not self._stop_requested.is_set()

    def _move_gripper(self, opening: float) -> None:
        self._driver.move_gripper(opening)
        self._on_gripper(opening)

    def _opening(self) -> float:
        return self._driver.gripper_opening() if self._has_gripper else float("nan")
