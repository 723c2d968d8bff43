"""What each register of the command port does; numbers and parameters as xarm-python-sdk sends them."""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from xarm_bridge.emulator.controller import Controller, RefusedError
from xarm_bridge.emulator.gripper import Gripper
from xarm_bridge.emulator.identity import serial_field, version_field
from xarm_bridge.emulator.kinematics import JOINTS, Pose, forward, inverse, outside_limits
from xarm_bridge.emulator.protocol import Status, pack_floats, unpack_floats

TOOL_RS485 = 9
"""Host id of the RS485 line in the tool; the gripper is on it."""
BAUD_RATE_REGISTER = 0x0A0B
BAUD_RATE_2M = 11
"""Index of 2 Mbit/s, the xArm gripper's rate, in the protocol's list of rates."""

ACCEPTED_WITHOUT_EFFECT = frozenset({31, 32, 33, 34, 36, 37, 38, 40, 51, 127, 129})
"""Settings with no meaning here: jerk and acceleration limits, payload, sensitivities, gravity, tool IO."""


@dataclass(frozen=True, kw_only=True)
class Devices:
    """What the registers act on."""

    serial: str
    """Serial number of the arm."""
    controller: Controller
    gripper: Gripper


Handler = Callable[[Devices, bytes], bytes]


class Answer(NamedTuple):
    """What a request is answered with."""

    status: Status
    params: bytes
    accepted: bool
    """Whether the request was carried out or queued."""


def answer(devices: Devices, register: int, params: bytes) -> Answer:
    """Carry out one request.

    An unknown register, parameters that are too short and a refused command are answered, never raised.
    """
    handler = HANDLERS.get(register)
    refusal = Status.OK
    reply = b""
    accepted = True
    if handler is None:
        accepted = register in ACCEPTED_WITHOUT_EFFECT
        refusal = Status.OK if accepted else Status.INVALID
    else:
        try:
            reply = handler(devices, params)
        except RefusedError as reason:
            refusal, reply, accepted = reason.status, reason.reply, False
        except (ValueError, IndexError, struct.error):
            refusal, accepted = Status.INVALID, False
    return Answer(devices.controller.status | refusal, reply, accepted)


def _finite_floats(params: bytes, count: int) -> tuple[float, ...]:
    values = unpack_floats(params, count)
    if not np.isfinite(values).all():
        raise ValueError(f"parameters must be finite, got {values}")
    return values


def _goal_floats(params: bytes, count: int, axes: int) -> tuple[float, ...]:
    """Like `_finite_floats`, but the first `axes` may be infinite: such an axis keeps its value."""
    values = unpack_floats(params, count)
    if np.isnan(values[:axes]).any() or not np.isfinite(values[axes:]).all():
        raise ValueError(f"parameters must be finite or, of axes, infinite, got {values}")
    return values


def _keeping(goal: tuple[float, ...], present: Iterable[float]) -> np.ndarray:
    """The goal with the present value of every axis that shall keep it."""
    return np.where(np.isinf(goal), np.fromiter(present, float), goal)


def _flag(params: bytes, index: int) -> int:
    return params[index] if len(params) > index else 0


def _motion_enable(devices: Devices, params: bytes) -> bytes:
    devices.controller.enable_motors(params[0], bool(params[1]))
    return b""


def _set_state(devices: Devices, params: bytes) -> bytes:
    devices.controller.set_state(params[0])
    return b""


def _set_mode(devices: Devices, params: bytes) -> bytes:
    devices.controller.set_mode(params[0])
    return b""


def _clean_error(devices: Devices, params: bytes) -> bytes:
    devices.controller.clean_error()
    return b""


def _clean_warning(devices: Devices, params: bytes) -> bytes:
    devices.controller.clean_warning()
    return b""


def _line(devices: Devices, params: bytes) -> bytes:
    """Registers 21 and 22; the longer form adds radius, frame (0 base, 1 tool), axis-angle and check-only."""
    in_tool_frame, axis_angle, check_only = (_flag(params, 40 + index) for index in range(3))
    may_keep = 0 if in_tool_frame or axis_angle else 6
    *target, speed, acceleration, _ = _goal_floats(params, 9, may_keep)
    controller = devices.controller

    def goal_from(tool: Pose) -> Pose:
        if axis_angle:
            pose = Pose(np.array(target[:3]), Rotation.from_rotvec(target[3:]))
        else:
            pose = Pose.from_wire(tuple(_keeping(tuple(target), tool.to_wire())))
        return tool @ pose if in_tool_frame else pose

    if check_only:
        goal = goal_from(controller.tool) @ controller.tcp_offset.inverse()
        return struct.pack(">HB", controller.queued, controller.trouble_at(goal))
    controller.line(goal_from, speed, acceleration)
    return struct.pack(">HB", controller.queued, 0)


def _line_in_tool_frame(devices: Devices, params: bytes) -> bytes:
    values = _finite_floats(params, 9)
    target = Pose.from_wire(values)
    devices.controller.line(lambda tool: tool @ target, values[6], values[7])
    return b""


def _joints(devices: Devices, params: bytes) -> bytes:
    values = _goal_floats(params, 10, JOINTS + 1)
    devices.controller.turn_joints(lambda joints: _keeping(values[:JOINTS], joints), values[7], values[8])
    return b""


def _home(devices: Devices, params: bytes) -> bytes:
    speed, acceleration, _ = _finite_floats(params, 3)
    devices.controller.turn_joints(np.zeros_like, speed, acceleration)
    return b""


def _relative(devices: Devices, params: bytes) -> bytes:
    values = _finite_floats(params, 11)
    change, speed, acceleration = np.array(values[:JOINTS]), values[7], values[8]
    if _flag(params, 44):
        devices.controller.turn_joints(lambda joints: joints + change, speed, acceleration)
    else:
        devices.controller.line(
            lambda tool: Pose.from_wire(tuple(np.array(tool.to_wire()) + change)), speed, acceleration
        )
    return b""


def _servo_joints(devices: Devices, params: bytes) -> bytes:
    devices.controller.servo_joints_to(np.array(_finite_floats(params, 10)[:JOINTS]))
    return b""


def _servo_line(devices: Devices, params: bytes) -> bytes:
    values = _finite_floats(params, 9)
    target, in_tool_frame = Pose.from_wire(values), bool(values[8])
    devices.controller.servo_to(devices.controller.tool @ target if in_tool_frame else target)
    return b""


def _set_tcp_offset(devices: Devices, params: bytes) -> bytes:
    devices.controller.set_tcp_offset(Pose.from_wire(_finite_floats(params, 6)))
    return b""


def _get_joints(devices: Devices, params: bytes) -> bytes:
    """Angles; with a count of 2 or 3 also speeds and torques, which are zero here."""
    kinds = max(1, _flag(params, 0) & 0x0F)
    return pack_floats([*devices.controller.joints, 0.0, *[0.0] * 7 * (kinds - 1)])


def _inverse_kinematics(devices: Devices, params: bytes) -> bytes:
    goal = Pose.from_wire(_finite_floats(params, 6)) @ devices.controller.tcp_offset.inverse()
    joints = inverse(goal, devices.controller.joints)
    if joints is None or outside_limits(joints):
        raise RefusedError(Status.INVALID, pack_floats([0.0] * 7))
    return pack_floats([*joints, 0.0])


def _forward_kinematics(devices: Devices, params: bytes) -> bytes:
    joints = np.array(_finite_floats(params, 7)[:JOINTS])
    return pack_floats((forward(joints) @ devices.controller.tcp_offset).to_wire())


def _is_joint_limit(devices: Devices, params: bytes) -> bytes:
    return bytes([outside_limits(np.array(_finite_floats(params, 7)[:JOINTS]))])


def _is_tcp_limit(devices: Devices, params: bytes) -> bytes:
    goal = Pose.from_wire(_finite_floats(params, 6)) @ devices.controller.tcp_offset.inverse()
    return bytes([devices.controller.trouble_at(goal) != 0])


def _pose_axis_angle(devices: Devices, params: bytes) -> bytes:
    tool = devices.controller.tool
    return pack_floats([*tool.position, *tool.rotation.as_rotvec()])


def _rs485(devices: Devices, params: bytes) -> bytes:
    """A Modbus RTU frame for the tool line; a silent line answers nothing but the host id."""
    return params[:1] + (devices.gripper.answer(params[1:]) if params[0] == TOOL_RS485 else b"")


def _tool_register(devices: Devices, params: bytes) -> bytes:
    _, address = struct.unpack_from(">BH", params)
    return struct.pack(">i", BAUD_RATE_2M if address == BAUD_RATE_REGISTER else 0)


HANDLERS: dict[int, Handler] = {
    1: lambda devices, params: version_field(devices.serial),
    2: lambda devices, params: serial_field(devices.serial),
    11: _motion_enable,
    12: _set_state,
    13: lambda devices, params: bytes([devices.controller.state]),
    14: lambda devices, params: struct.pack(">H", devices.controller.queued),
    15: lambda devices, params: bytes([devices.controller.error, devices.controller.warning]),
    16: _clean_error,
    17: _clean_warning,
    19: _set_mode,
    21: _line,
    22: _line,
    23: _joints,
    24: _joints,
    25: _home,
    28: _line_in_tool_frame,
    29: _servo_joints,
    30: _servo_line,
    35: _set_tcp_offset,
    41: lambda devices, params: pack_floats(devices.controller.tool.to_wire()),
    42: _get_joints,
    43: _inverse_kinematics,
    44: _forward_kinematics,
    45: _is_joint_limit,
    46: _is_tcp_limit,
    83: _relative,
    91: _pose_axis_angle,
    124: _rs485,
    125: lambda devices, params: bytes(2),
    128: _tool_register,
    130: _tool_register,
}
