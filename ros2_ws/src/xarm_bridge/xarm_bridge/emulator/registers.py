"""What each register of the command port does; numbers and parameters as xarm-python-sdk sends them."""

import logging
import struct
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from xarm_bridge.emulator.devices import Devices, Handler, finite_floats, flag
from xarm_bridge.emulator.identity import serial_field, version_field
from xarm_bridge.emulator.motion_registers import MOTION_HANDLERS
from xarm_bridge.emulator.names import register_title
from xarm_bridge.emulator.protocol import Status, pack_floats
from xarm_bridge.emulator.reduced import WIRE_JOINTS
from xarm_bridge.emulator.states import RefusedError
from xarm_bridge.kinematics import JOINTS, Pose, forward, inverse

log = logging.getLogger("xarm_emulator")

TOOL_RS485 = 9
"""Host id of the RS485 line in the tool; the gripper is on it."""
BAUD_RATE_REGISTER = 0x0A0B
BAUD_RATE_2M = 11
"""Index of 2 Mbit/s, the xArm gripper's rate, in the protocol's list of rates."""

ACCEPTED_WITHOUT_EFFECT = frozenset({31, 32, 33, 34, 36, 37, 38, 40, 51, 127, 129})
"""Settings with no meaning here: jerk and acceleration limits, payload, sensitivities, gravity, tool IO."""


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
        _name_once(devices, register, accepted)
    else:
        try:
            reply = handler(devices, params)
        except RefusedError as reason:
            refusal, reply, accepted = reason.status, reason.reply, False
        except (ValueError, IndexError, struct.error):
            refusal, accepted = Status.INVALID, False
    return Answer(devices.controller.status | refusal, reply, accepted)


def _name_once(devices: Devices, register: int, accepted: bool) -> None:
    """Say what is not emulated, the first time it is asked for."""
    if register not in devices.named:
        devices.named.add(register)
        log.warning("%s is %s", register_title(register), "accepted without effect" if accepted else "not emulated")


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


def _set_tcp_offset(devices: Devices, params: bytes) -> bytes:
    devices.controller.set_tcp_offset(Pose.from_wire(finite_floats(params, 6)))
    return b""


def _get_joints(devices: Devices, params: bytes) -> bytes:
    """Angles; with a count of 2 or 3 also speeds, and torques, which are zero here."""
    kinds = max(1, flag(params, 0) & 0x0F)
    values = [*devices.controller.arm.joints, 0.0, *devices.controller.arm.joint_speeds, 0.0, *[0.0] * 7]
    return pack_floats(values[: 7 * kinds])


def _inverse_kinematics(devices: Devices, params: bytes) -> bytes:
    goal = Pose.from_wire(finite_floats(params, 6)) @ devices.controller.arm.tcp_offset.inverse()
    joints = inverse(goal, devices.controller.arm.joints)
    if joints is None or devices.controller.reduced.joints_outside(joints):
        raise RefusedError(Status.INVALID, pack_floats([0.0] * 7))
    return pack_floats([*joints, 0.0])


def _forward_kinematics(devices: Devices, params: bytes) -> bytes:
    joints = np.array(finite_floats(params, 7)[:JOINTS])
    return pack_floats((forward(joints) @ devices.controller.arm.tcp_offset).to_wire())


def _is_joint_limit(devices: Devices, params: bytes) -> bytes:
    return bytes([devices.controller.reduced.joints_outside(np.array(finite_floats(params, 7)[:JOINTS]))])


def _is_tcp_limit(devices: Devices, params: bytes) -> bytes:
    return bytes([devices.controller.arm.trouble_at(Pose.from_wire(finite_floats(params, 6))) != 0])


def _set_reduced_tool_speed(devices: Devices, params: bytes) -> bytes:
    reduced, (speed,) = devices.controller.reduced, finite_floats(params, 1)
    reduced.settings = replace(reduced.settings, tool_speed=speed)
    return b""


def _set_reduced_joint_speed(devices: Devices, params: bytes) -> bytes:
    reduced, (speed,) = devices.controller.reduced, finite_floats(params, 1)
    reduced.settings = replace(reduced.settings, joint_speed=speed)
    return b""


def _set_boundary(devices: Devices, params: bytes) -> bytes:
    """Six little-endian int32, as ever only here; read back they are int16."""
    boundary = struct.unpack("<6i", params)
    struct.pack(">6h", *boundary)  # refuses what could not be read back
    reduced = devices.controller.reduced
    reduced.settings = replace(reduced.settings, boundary=boundary)
    return b""


def _set_reduced_joint_ranges(devices: Devices, params: bytes) -> bytes:
    reduced = devices.controller.reduced
    reduced.settings = replace(reduced.settings, joint_ranges=finite_floats(params, 2 * WIRE_JOINTS))
    return b""


def _set_reduced_mode(devices: Devices, params: bytes) -> bytes:
    devices.controller.reduced.switch(bool(params[0]))
    return b""


def _set_fence(devices: Devices, params: bytes) -> bytes:
    devices.controller.reduced.switch_fence(bool(params[0]))
    return b""


def _feedback_check(devices: Devices, params: bytes) -> bytes:
    """A task behind all others, whose end tells that they have ended."""
    devices.controller.mark()
    return b""


def _reduced_states(devices: Devices, params: bytes) -> bytes:
    reduced = devices.controller.reduced
    return bytes([reduced.is_on]) + reduced.encode() + bytes([reduced.fence_is_on, 0])  # collision rebound


def _pose_axis_angle(devices: Devices, params: bytes) -> bytes:
    tool = devices.controller.arm.tool
    return pack_floats([*tool.position, *tool.rotation.as_rotvec()])


def _rs485(devices: Devices, params: bytes) -> bytes:
    """A Modbus RTU frame for the tool line; a silent line answers nothing but the host id."""
    return params[:1] + (devices.gripper.answer(params[1:]) if params[0] == TOOL_RS485 else b"")


def _tool_register(devices: Devices, params: bytes) -> bytes:
    _, address = struct.unpack_from(">BH", params)
    return struct.pack(">i", BAUD_RATE_2M if address == BAUD_RATE_REGISTER else 0)


HANDLERS: dict[int, Handler] = {
    **MOTION_HANDLERS,
    1: lambda devices, params: version_field(devices.serial),
    2: lambda devices, params: serial_field(devices.serial),
    11: _motion_enable,
    12: _set_state,
    13: lambda devices, params: bytes([devices.controller.state]),
    14: lambda devices, params: struct.pack(">H", len(devices.controller.queue)),
    15: lambda devices, params: bytes([devices.controller.error, devices.controller.warning]),
    16: _clean_error,
    17: _clean_warning,
    19: _set_mode,
    35: _set_tcp_offset,
    41: lambda devices, params: pack_floats(devices.controller.arm.tool.to_wire()),
    42: _get_joints,
    43: _inverse_kinematics,
    44: _forward_kinematics,
    45: _is_joint_limit,
    46: _is_tcp_limit,
    47: _set_reduced_tool_speed,
    48: _set_reduced_joint_speed,
    49: lambda devices, params: bytes([devices.controller.reduced.is_on]),
    50: _set_reduced_mode,
    52: _set_boundary,
    53: _reduced_states,
    58: _set_reduced_joint_ranges,
    59: _set_fence,
    91: _pose_axis_angle,
    124: _rs485,
    125: lambda devices, params: bytes(2),
    128: _tool_register,
    130: _tool_register,
    253: _feedback_check,
}
