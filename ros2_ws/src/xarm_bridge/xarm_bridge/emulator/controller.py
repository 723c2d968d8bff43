"""The emulated arm: modes, states, errors and the motion they allow. Knows no sockets and no wall clock."""

import logging
import math
from collections.abc import Callable

import numpy as np

from xarm_bridge.emulator.circle import CircleMove
from xarm_bridge.emulator.mechanics import Mechanics
from xarm_bridge.emulator.motion import Dwell, JointMove, LineMove, Place
from xarm_bridge.emulator.motion_queue import MotionQueue
from xarm_bridge.emulator.protocol import Status
from xarm_bridge.emulator.reduced import ReducedMode
from xarm_bridge.emulator.states import CIRCLE_ERROR, MOTORS_LOSE_POWER, Mode, MotionError, RefusedError, State
from xarm_bridge.emulator.streaming import SERVO_LARGEST_STEP, JointVelocity, Velocity, towards_joints, towards_pose
from xarm_bridge.kinematics import JOINTS, Pose

log = logging.getLogger("xarm_emulator")

SLOWEST = 0.1
"""mm/s or degree/s: the controller raises smaller speeds to this."""
SLOWEST_JOINT = 1e-4
"""rad/s, the same for joints."""


class Controller:
    """An xArm6 with its control box. Time is given by the caller through `advance`.

    Simplifications: a stop halts at once instead of braking over a few millimetres, blend radii are
    ignored (every line ends at rest), and dynamics (payload, collision) are absent.
    """

    def __init__(self, start: Pose) -> None:
        """Powered up with the motors off, the flange at `start`.

        Raises:
            ValueError: the arm cannot reach `start`.
        """
        self.reduced = ReducedMode()
        self.arm = Mechanics(start, self.reduced)
        self.mode = Mode.POSITION
        self.error = 0
        self.warning = 0
        self.motors = [False] * JOINTS
        self.motion_commands = 0
        self.queue = MotionQueue()
        self._stopped = True
        self._mode_changed = False
        self._paused = False
        self._servo_target: Pose | np.ndarray | None = None
        self._velocity: Velocity | None = None
        self._velocity_ends = math.inf
        self._now = 0.0

    @property
    def state(self) -> State:
        """The state the controller reports now."""
        if self.error or self._stopped:
            return State.STOPPED
        if self._mode_changed:
            return State.MODE_CHANGED
        if self._paused:
            return State.PAUSED
        moving = len(self.queue) or self._servo_target is not None or self._velocity is not None
        return State.MOVING if moving else State.READY

    @property
    def status(self) -> Status:
        """The status byte of every reply."""
        status = Status.OK
        if self.error:
            status |= Status.ERROR
        if self.warning:
            status |= Status.WARNING
        if self.state >= State.STOPPED or not all(self.motors):
            status |= Status.NOT_READY
        return status

    def advance(self, now: float) -> None:
        """Move on to a time in seconds; earlier times change nothing."""
        elapsed = now - self._now
        if elapsed <= 0:
            return
        self._now = now
        try:
            if self.state is State.MOVING:
                self._move(elapsed)
        except MotionError as trouble:
            self.raise_error(trouble.code)
        self.arm.measure_speeds(now)

    def enable_motors(self, axis: int, enable: bool) -> None:
        """Axis 1 to 6 as on the wire, 8 for all."""
        if axis == 8:
            self.motors = [enable] * JOINTS
        elif 1 <= axis <= JOINTS:
            self.motors[axis - 1] = enable
        elif axis != JOINTS + 1:  # the seventh axis of other models: accepted, not there
            raise RefusedError
        if not all(self.motors):
            self._drop_motion()

    def set_state(self, value: int) -> None:
        """0 lets motion run, 3 pauses it, 4 stops it and forgets what was queued."""
        if value == 0:
            if self.error:
                raise RefusedError(Status.OK)  # the reply's status says so; the error must be cleared first
            self._stopped = self._mode_changed = self._paused = False
        elif value == 3:
            self._paused = True
        elif value == 4:
            self.stop()
        else:
            raise RefusedError

    def set_mode(self, value: int) -> None:
        """Change the mode; motion is dropped and state 5 stays until `set_state(0)`."""
        if value not in list(Mode):
            log.warning("mode %d is not emulated", value)
            raise RefusedError
        self._drop_motion()
        self.mode = Mode(value)
        self._mode_changed = True

    def set_tcp_offset(self, offset: Pose) -> None:
        """Pose of the TCP in the flange frame; like a mode change it needs `set_state(0)` afterwards."""
        self._drop_motion()
        self.arm.set_tcp_offset(offset)
        self._mode_changed = True

    def stop(self) -> None:
        """Stand still now and stay so until `set_state(0)`."""
        self._drop_motion()
        self._stopped = True
        self._paused = False

    def raise_error(self, code: int) -> None:
        """Enter the error state with a controller error code."""
        log.warning("controller error %d", code)
        self.error = code
        self.stop()
        if code in MOTORS_LOSE_POWER:
            self.motors = [False] * JOINTS

    def clean_error(self) -> None:
        """Clear the error; the arm stays stopped."""
        self.error = 0

    def clean_warning(self) -> None:
        """Clear the warning."""
        self.warning = 0

    def line(self, goal_from: Callable[[Pose], Pose], speed: float, acceleration: float) -> None:
        """Queue a straight line of the TCP, in mm/s and mm/s^2.

        `goal_from` gives the goal from the TCP pose where the line starts, so relative lines can be queued.
        """
        self._check(Mode.POSITION)

        def plan() -> LineMove:
            goal = goal_from(self.arm.tool)
            self._check_reach(goal)
            return LineMove.between(self.arm.tool, goal, self._tool_speed(speed), max(acceleration, SLOWEST))

        self.queue.add(plan)

    def circle(
        self, points_from: Callable[[Pose], tuple[Pose, Pose]], rounds: float, speed: float, acceleration: float
    ) -> None:
        """Queue so many rounds (above 0) of the circle through the TCP and two more points, in mm/s and mm/s^2."""
        self._check(Mode.POSITION)

        def plan() -> CircleMove:
            first, second = points_from(self.arm.tool)
            move = CircleMove.through(
                self.arm.tool, first, second, rounds, self._tool_speed(speed), max(acceleration, SLOWEST)
            )
            if move is None:
                raise MotionError(CIRCLE_ERROR)
            return move

        self.queue.add(plan)

    def turn_joints(self, goal_from: Callable[[np.ndarray], np.ndarray], speed: float, acceleration: float) -> None:
        """Queue a joint move, in rad/s and rad/s^2; `goal_from` gives the goal [6] from the start [6]."""
        self._check(Mode.POSITION)

        def plan() -> JointMove:
            goal = goal_from(self.arm.joints)
            self._check_reach(goal)
            fastest = max(min(speed, self.reduced.speeds.joints), SLOWEST_JOINT)
            return JointMove.between(self.arm.joints, goal, fastest, max(acceleration, SLOWEST_JOINT))

        self.queue.add(plan)

    def dwell(self, duration: float) -> None:
        """Queue seconds of standing still."""
        self._check(Mode.POSITION)
        self.queue.add(lambda: Dwell(duration))

    def mark(self) -> None:
        """Queue a task that ends at once, when all before it have ended; other modes than position have no queue."""
        if self.mode is Mode.POSITION and self.state < State.STOPPED:
            self.queue.add(lambda: Dwell(0.0))

    def servo_to(self, goal: Pose) -> None:
        """Newest servo target of the TCP; older ones are forgotten."""
        self._check(Mode.SERVO)
        last = self._servo_target if isinstance(self._servo_target, Pose) else self.arm.tool
        step = float(np.linalg.norm(goal.position - last.position))
        if step > SERVO_LARGEST_STEP:
            log.warning("servo target %.1f mm away not executed, at most %.0f mm", step, SERVO_LARGEST_STEP)
            raise RefusedError(Status.OK)  # clients are not told
        self._servo_target = goal

    def servo_joints_to(self, goal: np.ndarray) -> None:
        """Newest joint servo target [6], radians."""
        self._check(Mode.SERVO)
        self._servo_target = goal

    def move_at(self, velocity: Velocity, duration: float) -> None:
        """Newest velocity, for so many seconds (0 or less: until the next one)."""
        self._check(Mode.JOINT_VELOCITY if isinstance(velocity, JointVelocity) else Mode.TOOL_VELOCITY)
        self._velocity = None if velocity.is_zero else velocity
        self._velocity_ends = self._now + duration if duration > 0 else math.inf

    def _check(self, mode: Mode) -> None:
        """Motion is refused in error, when not ready, in the wrong mode."""
        if self.status & (Status.ERROR | Status.NOT_READY):
            raise RefusedError(Status.OK)  # the reply's own status bits already say why
        if self.mode is not mode:
            raise RefusedError
        self.motion_commands += 1

    def _check_reach(self, goal: Place) -> None:
        if trouble := self.arm.trouble_at(goal):
            raise MotionError(trouble)

    def _drop_motion(self) -> None:
        self.queue.drop()
        self._servo_target = None
        self._velocity = None

    def _tool_speed(self, asked: float) -> float:
        return max(min(asked, self.reduced.speeds.tool), SLOWEST)

    def _move(self, elapsed: float) -> None:
        if self.mode is Mode.SERVO:
            self._chase(elapsed)
        elif self.mode is Mode.POSITION:
            while elapsed > 0 and len(self.queue):
                place, elapsed = self.queue.follow(elapsed)
                self.arm.go(place)
        elif self._velocity is not None:
            velocity = self._velocity.limited(self.reduced.speeds)
            began, ends = self._now - elapsed, min(self._now, self._velocity_ends)
            if ends < self._now:
                self._velocity = None
            self.arm.go(velocity.carry(self.arm.tool, self.arm.joints, max(ends - began, 0.0)))

    def _chase(self, elapsed: float) -> None:
        """Towards the newest target as fast as servo mode goes, and hold there."""
        target, speeds = self._servo_target, self.reduced.speeds
        if target is None:
            return
        if isinstance(target, Pose):
            place, arrived = towards_pose(target, self.arm.tool, elapsed, speeds)
            self.arm.go(place)
        else:
            joints, arrived = towards_joints(target, self.arm.joints, elapsed, speeds)
            self.arm.go(joints)
        if arrived:
            self._servo_target = None
