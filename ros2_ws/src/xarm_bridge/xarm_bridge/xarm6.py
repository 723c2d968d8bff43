"""The xArm6 as an `ArmDriver`: the only module that touches the xArm SDK, with SI units and errors on this side."""

import contextlib
import ipaddress
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.errors import ArmFaultError, ArmLostError, RobotError
from egophys_core.robot import ArmDriver, ArmIdentity, ArmState, Transform
from xarm_bridge.kinematics import JOINT_LIMITS, Pose, inverse_near
from xarm_bridge.user_registers import UserRegisters

# The SDK prints when it is imported and binds its loggers to what is stdout then; results belong on stdout.
with contextlib.redirect_stdout(sys.stderr):
    from xarm.core.config.x_code import ControllerErrorCodeMap
    from xarm.wrapper import XArmAPI

CONNECT_TIMEOUT = 5.0
"""Seconds; the SDK itself would ask a controller that never answers for over three minutes."""
RETRY_INTERVAL = 0.5
COMMAND_TIMEOUT = 1.0
"""Seconds a controller may take to answer; real ones answer within milliseconds."""
REPORT_TIMEOUT = 3.0
"""Seconds to wait for what only the 5 Hz status reports tell (the mode, the first sign of the stream)."""
POLL_INTERVAL = 0.02

POSITION_MODE, SERVO_MODE = 0, 1
RUN, STOP = 0, 4
"""States that can be commanded."""

HAS_ERROR, HAS_WARNING, NO_ANSWER, NOT_READY, REFUSED = 1, 2, 3, 9, 10
"""Return codes of the SDK that mean something special here."""

PULSES_PER_METRE = 10000.0
"""xArm gripper: 850 pulses are 0.085 m between the fingers."""
GRIPPER_SPEED = 3000
"""r/min of the gripper's motor, of at most 5000."""


POSES_PER_QUESTION = 10
"""Of a path of poses 5 mm apart the controller is asked for each tenth: it takes a millisecond or more to answer."""
LARGEST_JOINT_STEP = 0.3
"""Radians between poses 5 mm apart; near a singular pose joints would have to jump."""
FIRST_NOTE_REGISTER = 480
"""The last of the registers for users, 256 to 511, which other programs are least likely to use."""
EMULATOR_MARK = "EMU"
"""In the serial number of every emulated control box, and of no real one."""


class XArm6(ArmDriver):
    """A UFACTORY xArm6 with its control box and, if it has one, its gripper. The SDK sends one request at a time."""

    joint_names = tuple(f"joint{number}" for number in range(1, 7))
    # UFACTORY advises 100 to 200 Hz and warns below 30 Hz; targets farther apart than 10 mm are not executed (Guide to
    # use set_servo_cartesian).
    stream_period = 0.01
    largest_pose_step = 0.01

    def __init__(self, address: str) -> None:
        """Connect to nothing yet.

        Args:
            address: IPv4 address of the control box, or of an emulator.

        Raises:
            RobotError: no IPv4 address.
        """
        try:
            is_loopback = ipaddress.IPv4Address(address).is_loopback
        except ValueError as error:
            # The SDK would take anything else for the name of a serial port.
            raise RobotError(f"robot address {address!r} is no IPv4 address such as 192.168.1.200") from error
        self._address = address
        # Where an emulator's Unix sockets lie on this machine the SDK would attach to them, whatever the address.
        self._options = {"is_radian": True, "do_not_open": True, "forbid_uds": not is_loopback}
        self._api = XArmAPI(address, **self._options)
        self._registers = UserRegisters(address, is_local=is_loopback)
        self._reported = threading.Event()

    def connect(self, *, patience: float = 0.0) -> ArmIdentity:
        """Connect, or connect anew, and tell which control box answered."""
        self.close()
        self._api = XArmAPI(self._address, **self._options)
        self._reported.clear()
        with _process_settings_kept():
            self._open(patience)
        serial = self._serial()
        return ArmIdentity(serial=serial, address=self._address, is_emulator=EMULATOR_MARK in serial)

    def close(self) -> None:
        """Disconnect; the arm stays as it is."""
        self._registers.close()
        with _process_settings_kept():
            self._api.disconnect()

    def state(self) -> ArmState:
        """Pose and joint angles, asked one after the other: about a millisecond apart."""
        values = self._call("reading the pose", self._api.get_position)
        stamp_ns = time.time_ns()
        angles = self._call("reading the joints", self._api.get_servo_angle)
        tcp = Transform.from_rpy(np.array(values[:3]) / 1000.0, np.array(values[3:6]))
        return ArmState(stamp_ns=stamp_ns, tcp=tcp, joints=np.array(angles[: len(self.joint_names)]))

    def begin_streaming(self) -> None:
        """Enable the motors and enter the servo mode.

        Raises:
            RobotError: the controller has an error, or the mode was not reached.
        """
        self._check_error_free()
        self._call("enabling the motors", self._api.motion_enable, True)
        self._enter_mode(SERVO_MODE)

    def end_streaming(self) -> None:
        """Back to the position mode, ready, so that other programs find the arm as usual."""
        self._enter_mode(POSITION_MODE)

    def stream(self, pose: Transform) -> None:
        """Newest target of the servo mode; must be close to the one before (10 mm at most)."""
        target = [*(pose.translation * 1000.0).tolist(), *pose.rpy.tolist()]
        self._call("streaming a pose", self._api.set_servo_cartesian, target)

    def first_unreachable(self, poses: Sequence[Transform]) -> int | None:
        """By the manual's kinematics, from the present joints on; now and then the controller is asked, too."""
        joints = self.state().joints
        offset = Pose.from_wire(tuple(self._api.tcp_offset)).inverse()
        for index, pose in enumerate(poses):
            tcp = Pose(pose.translation * 1000.0, Rotation.from_matrix(pose.rotation))
            followed = inverse_near(tcp @ offset, joints)
            if followed is None or not _may_go(joints, followed):
                return index
            joints = followed
            if (index % POSES_PER_QUESTION == 0 or index == len(poses) - 1) and not self._allows(pose):
                return index
        return None

    def _allows(self, pose: Transform) -> bool:
        """Whether the controller's own inverse kinematics has a solution, inside the boundaries it was given."""
        target = [*(pose.translation * 1000.0).tolist(), *pose.rpy.tolist()]
        code, _ = self._api.get_inverse_kinematics(target)
        if code == REFUSED:
            return False
        self._check(code, "asking for the inverse kinematics")
        return True

    def read_note(self, size: int) -> list[int]:
        """Numbers of the box's holding registers."""
        return self._registers.read(FIRST_NOTE_REGISTER, size)

    def write_note(self, numbers: list[int]) -> None:
        """Set numbers of the box's holding registers."""
        self._registers.write(FIRST_NOTE_REGISTER, numbers)

    def prepare_gripper(self) -> None:
        """Enable the gripper; it does not move."""
        self._call("enabling the gripper", self._api.set_gripper_enable, True)
        self._call("setting the gripper's mode", self._api.set_gripper_mode, 0)
        self._call("setting the gripper's speed", self._api.set_gripper_speed, GRIPPER_SPEED)

    def move_gripper(self, opening: float) -> None:
        """Start opening or closing to `opening` metres between the fingers; does not wait."""
        # Without these switches the SDK first waits for the arm, which here is meant to move meanwhile.
        options = {"wait": False, "wait_motion": False, "check_baud": False, "check_err": False}
        pulses = round(opening * PULSES_PER_METRE)
        self._call("moving the gripper", self._api.set_gripper_position, pulses, **options)

    def gripper_opening(self) -> float:
        """Measured opening, metres."""
        doing = "reading the gripper"
        pulses = self._call(doing, self._api.get_gripper_position, check_baud=False)
        if pulses is None:
            # The SDK asks for the position and then for the gripper's error, and keeps to itself why the second
            # question was not answered; asked again, it tells.
            self._call(doing, self._api.get_gripper_err_code, check_baud=False)
            raise ArmLostError(f"{doing}: the controller at {self._address} answered without a position; is it on?")
        return float(pulses) / PULSES_PER_METRE

    def halt(self) -> None:
        """Stop the arm now and have the controller confirm it.

        Raises:
            ArmLostError: not confirmed; the message says to use the emergency stop button.
        """
        deadline = time.monotonic() + COMMAND_TIMEOUT
        while True:
            code = self._api.set_state(STOP)
            answer, state = self._api.get_state()
            if code == 0 and answer == 0 and state == STOP:
                return
            if time.monotonic() > deadline:
                raise ArmLostError(
                    f"stop was not confirmed by the controller at {self._address} (code {code}, "
                    f"state {state}); press the emergency stop button"
                )

    def error_code(self) -> int:
        """The controller's error code now, 0 if none (the SDK's own value is up to 0.2 s old)."""
        return int(self._call("reading the error code", self._api.get_err_warn_code)[0])

    def clear_error(self) -> None:
        """Clear error and warning and enable the motors; the arm stays stopped.

        Raises:
            RobotError: the error came back or stayed (an emergency stop button still pressed, say).
        """
        self._call("clearing the error", self._api.clean_error)
        self._call("clearing the warning", self._api.clean_warn)
        self._call("enabling the motors", self._api.motion_enable, True)
        self._check_error_free()

    def describe_error(self, code: int) -> str:
        """The code with UFACTORY's title of it."""
        title = ControllerErrorCodeMap.get(code, {}).get("en", {}).get("title", "unknown")
        return f"controller error {code} ({title}); look at the arm, remove the cause, then clear the error"

    def _open(self, patience: float) -> None:
        self._api.register_report_callback(lambda _: self._reported.set())
        deadline = time.monotonic() + patience
        while reason := self._try_to_connect():
            if time.monotonic() >= deadline:
                raise RobotError(f"no xArm controller at {self._address}: {reason}; check address, cable and power")
            time.sleep(RETRY_INTERVAL)
        self._api.set_timeout(COMMAND_TIMEOUT)
        if not self._reported.wait(REPORT_TIMEOUT):
            self._api.disconnect()
            raise RobotError(
                f"the controller at {self._address} answers but sends no status reports (port 30002); "
                "is the port blocked, or is another client holding too many connections?"
            )

    def _serial(self) -> str:
        return str(self._call("reading the serial number", self._api.get_robot_sn))

    def _try_to_connect(self) -> str:
        """Why it did not work, empty if it did."""
        failure: list[Exception] = []

        def connect() -> None:
            try:
                self._api.connect()
            except Exception as error:  # the SDK raises bare Exception
                failure.append(error)

        worker = threading.Thread(target=connect, name="xarm-connect", daemon=True)
        worker.start()
        worker.join(CONNECT_TIMEOUT)
        if not worker.is_alive() and not failure and self._api.connected:
            return ""
        self._api.disconnect()
        return str(failure[0]) if failure else f"no answer within {CONNECT_TIMEOUT:.0f} s"

    def _enter_mode(self, mode: int) -> None:
        self._call(f"entering mode {mode}", self._api.set_mode, mode)
        # A mode change leaves the controller in state 5, where it refuses motion until this.
        self._call("making the arm ready", self._api.set_state, RUN)
        deadline = time.monotonic() + REPORT_TIMEOUT
        while self._api.mode != mode:  # no register tells the mode, only the reports do
            if time.monotonic() > deadline:
                raise RobotError(
                    f"the controller at {self._address} did not report mode {mode} within "
                    f"{REPORT_TIMEOUT:.0f} s; are its status reports (port 30002) still coming?"
                )
            time.sleep(POLL_INTERVAL)

    def _check_error_free(self) -> None:
        code = self.error_code()
        if code:
            raise ArmFaultError(self.describe_error(code))

    def _call(self, doing: str, function: Callable[..., Any], *values: Any, **options: Any) -> Any:
        """Call the SDK, check its return code, give the value that came with it (None if none did)."""
        try:
            result = function(*values, **options)
        except (ValueError, IndexError, TypeError) as error:  # the SDK trips over short replies
            raise ArmLostError(f"{doing}: unusable answer from the controller at {self._address}: {error}") from error
        # Functions that return (code, value) return a bare code in some error branches.
        code, value = result if isinstance(result, tuple) else (result, None)
        self._check(code, doing)
        return value

    def _check(self, code: int, doing: str) -> None:
        if code in (0, HAS_WARNING):
            return
        if code == HAS_ERROR:
            raise ArmFaultError(f"{doing}: {self.describe_error(self.error_code())}")
        if not self._api.connected:
            raise ArmLostError(f"{doing}: connection to the controller at {self._address} is lost")
        if code == NO_ANSWER:
            raise ArmLostError(
                f"{doing}: no answer from the controller at {self._address} within {COMMAND_TIMEOUT} s; "
                "it hangs or the network is down"
            )
        if code == NOT_READY:
            raise RobotError(f"{doing}: the arm was stopped or disabled from elsewhere; look at it, then plan again")
        raise RobotError(f"{doing}: the controller at {self._address} refused (SDK code {code})")


def _may_go(joints: np.ndarray, to: np.ndarray) -> bool:
    """Whether joints [6] may go to others, radians: inside their ranges, and without a jump to another solution."""
    inside = (to >= JOINT_LIMITS[:, 0]) & (to <= JOINT_LIMITS[:, 1])
    return bool(inside.all() and np.abs(to - joints).max() < LARGEST_JOINT_STEP)


@contextlib.contextmanager
def _process_settings_kept() -> Iterator[None]:
    """Undo what the SDK does to the whole process: prints on stdout, a default timeout for every socket."""
    timeout = socket.getdefaulttimeout()
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        socket.setdefaulttimeout(timeout)
