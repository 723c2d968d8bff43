"""The emulated arm: modes, states, errors and the motion they allow. Knows no sockets and no wall clock."""

import enum
import logging
from collections import deque
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from xarm_bridge.emulator.kinematics import (
    JOINTS,
    READY_JOINTS,
    Pose,
    forward,
    inverse,
    outside_limits,
)
from xarm_bridge.emulator.motion import JointMove, LineMove
from xarm_bridge.emulator.protocol import Status

log = logging.getLogger("xarm_emulator")

SERVO_SPEED = 1000.0
"""mm/s; servo targets are run at the fastest tool speed (UFACTORY, Servo Mode Usage Guide)."""
SERVO_ANGULAR_SPEED = np.pi
"""rad/s, the same guide's 180 degrees per second."""
SERVO_LARGEST_STEP = 10.0
"""mm; farther targets are not executed (UFACTORY, Guide to use set_servo_cartesian)."""
SLOWEST = 0.1
"""mm/s or degree/s: the controller raises smaller speeds to this."""
SLOWEST_JOINT = 1e-4
"""rad/s, the same for joints."""

MOTORS_LOSE_POWER = frozenset(range(1, 18))
"""Emergency stop and servo errors: the brakes close and motion_enable is needed again."""
KINEMATIC_ERROR = 21
JOINT_LIMIT_ERROR = 23


class Mode(enum.IntEnum):
    """Modes emulated; a request for another one is answered as invalid."""

    POSITION = 0
    SERVO = 1


class State(enum.IntEnum):
    """States as the controller reports them."""

    MOVING = 1
    READY = 2
    PAUSED = 3
    STOPPED = 4
    MODE_CHANGED = 5


class RefusedError(Exception):
    """A command the controller answers with a status bit and does not carry out."""

    def __init__(self, status: Status = Status.INVALID, reply: bytes = b"") -> None:
        super().__init__(status)
        self.status = status
        self.reply = reply
        """Parameters of the reply; clients want their full length of a register they read."""


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
        joints = inverse(start, READY_JOINTS)
        if joints is None or outside_limits(joints):
            raise ValueError(f"an xArm6 cannot reach {np.round(start.to_wire(), 3).tolist()} (mm, rad)")
        self.joints = joints
        self.flange = start
        self.tcp_offset = Pose(np.zeros(3), Rotation.identity())
        self.mode = Mode.POSITION
        self.error = 0
        self.warning = 0
        self.motors = [False] * JOINTS
        self.tool_speed = 0.0
        self.motion_commands = 0
        self._stopped = True
        self._mode_changed = False
        self._paused = False
        self._queue: deque[Callable[[], LineMove | JointMove]] = deque()
        self._move: LineMove | JointMove | None = None
        self._move_time = 0.0
        self._servo_target: Pose | np.ndarray | None = None
        self._now = 0.0

    @property
    def tool(self) -> Pose:
        """TCP pose, with the TCP offset."""
        return self.flange @ self.tcp_offset

    @property
    def state(self) -> State:
        """The state the controller reports now."""
        if self.error or self._stopped:
            return State.STOPPED
        if self._mode_changed:
            return State.MODE_CHANGED
        if self._paused:
            return State.PAUSED
        moving = self._move is not None or self._queue or self._servo_target is not None
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

    @property
    def queued(self) -> int:
        """Number of motion commands not finished."""
        return len(self._queue) + (self._move is not None)

    def advance(self, now: float) -> None:
        """Move on to a time in seconds; earlier times change nothing."""
        elapsed = now - self._now
        if elapsed <= 0:
            return
        self._now = now
        before = self.flange.position
        if self.state is State.MOVING:
            if self.mode is Mode.SERVO:
                self._chase(elapsed)
            else:
                self._follow_queue(elapsed)
        self.tool_speed = float(np.linalg.norm(self.flange.position - before)) / elapsed

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
            raise RefusedError
        self._drop_motion()
        self.mode = Mode(value)
        self._mode_changed = True

    def set_tcp_offset(self, offset: Pose) -> None:
        """Pose of the TCP in the flange frame; like a mode change it needs `set_state(0)` afterwards."""
        self._drop_motion()
        self.tcp_offset = offset
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
        speed, acceleration = max(speed, SLOWEST), max(acceleration, SLOWEST)

        def start() -> LineMove:
            goal = goal_from(self.tool) @ self.tcp_offset.inverse()
            return LineMove.between(self.flange, goal, speed, acceleration)

        self._queue.append(start)

    def turn_joints(self, goal_from: Callable[[np.ndarray], np.ndarray], speed: float, acceleration: float) -> None:
        """Queue a joint move, in rad/s and rad/s^2; `goal_from` gives the goal [6] from the start [6]."""
        self._check(Mode.POSITION)
        speed, acceleration = max(speed, SLOWEST_JOINT), max(acceleration, SLOWEST_JOINT)
        self._queue.append(lambda: JointMove.between(self.joints, goal_from(self.joints), speed, acceleration))

    def servo_to(self, goal: Pose) -> None:
        """Newest Cartesian servo target of the TCP; older ones are forgotten."""
        self._check(Mode.SERVO)
        flange = goal @ self.tcp_offset.inverse()
        last = self._servo_target if isinstance(self._servo_target, Pose) else self.flange
        step = float(np.linalg.norm(flange.position - last.position))
        if step > SERVO_LARGEST_STEP:
            log.warning("servo target %.1f mm away not executed, at most %.0f mm", step, SERVO_LARGEST_STEP)
            raise RefusedError(Status.OK)  # clients are not told
        self._servo_target = flange

    def servo_joints_to(self, goal: np.ndarray) -> None:
        """Newest joint servo target [6], radians."""
        self._check(Mode.SERVO)
        self._servo_target = goal

    def _check(self, mode: Mode) -> None:
        """Motion is refused in error, when not ready, in the wrong mode."""
        if self.status & (Status.ERROR | Status.NOT_READY):
            raise RefusedError(Status.OK)  # the reply's own status bits already say why
        if self.mode is not mode:
            raise RefusedError
        self.motion_commands += 1

    def _drop_motion(self) -> None:
        self._queue.clear()
        self._move = None
        self._servo_target = None

    def _follow_queue(self, elapsed: float) -> None:
        while elapsed > 0 and self.state is State.MOVING:
            if self._move is None:
                self._move = self._queue.popleft()()
                self._move_time = 0.0
                trouble = self.trouble_at(self._move.goal)
                if trouble:
                    self.raise_error(trouble)
                    return
            self._move_time += elapsed
            elapsed = self._move_time - self._move.profile.duration
            move = self._move
            if elapsed >= 0:
                self._move = None
            if isinstance(move, LineMove):
                self._place_flange(move.pose_at(self._move_time))
            else:
                self._place_joints(move.joints_at(self._move_time))

    def _chase(self, elapsed: float) -> None:
        """Towards the newest target as fast as servo mode goes."""
        target = self._servo_target
        if isinstance(target, Pose):
            displacement = target.position - self.flange.position
            turn = (self.flange.rotation.inv() * target.rotation).as_rotvec()
            needed = max(
                float(np.linalg.norm(displacement)) / SERVO_SPEED, float(np.linalg.norm(turn)) / SERVO_ANGULAR_SPEED
            )
            share = min(1.0, elapsed / needed) if needed > 0 else 1.0
            rotation = self.flange.rotation * Rotation.from_rotvec(share * turn)
            self._place_flange(Pose(self.flange.position + share * displacement, rotation))
        elif target is not None:
            displacement = target - self.joints
            needed = float(np.abs(displacement).max()) / SERVO_ANGULAR_SPEED
            share = min(1.0, elapsed / needed) if needed > 0 else 1.0
            self._place_joints(self.joints + share * displacement)
        else:
            return
        if share == 1.0:
            self._servo_target = None

    def trouble_at(self, goal: Pose | np.ndarray) -> int:
        """The error code that going to a flange pose or joint angles [6] ends with, 0 if none."""
        joints = inverse(goal, self.joints) if isinstance(goal, Pose) else goal
        if joints is None:
            return KINEMATIC_ERROR
        return JOINT_LIMIT_ERROR if outside_limits(joints) else 0

    def _place_flange(self, pose: Pose) -> None:
        joints = inverse(pose, self.joints)
        if joints is None:
            self.raise_error(KINEMATIC_ERROR)
        elif outside_limits(joints):
            self.raise_error(JOINT_LIMIT_ERROR)
        else:
            self.flange, self.joints = pose, joints

    def _place_joints(self, joints: np.ndarray) -> None:
        if outside_limits(joints):
            self.raise_error(JOINT_LIMIT_ERROR)
        else:
            self.joints, self.flange = joints, forward(joints)
