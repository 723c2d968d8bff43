"""Status reports: what the controller streams on its report ports, byte for byte.

Floats are little-endian float32, integers big-endian. The layouts follow the firmware's "normal" (145 bytes),
"rich" (587 bytes) and "real" (135 bytes) reports; fields this emulator has no value for are zero.
"""

import struct

import numpy as np

from xarm_bridge.emulator.controller import Controller
from xarm_bridge.emulator.identity import ARM_TYPE, AXES, FIRMWARE
from xarm_bridge.emulator.protocol import pack_floats

ALL_JOINT_BITS = 0x7F
COLLISION_SENSITIVITY = 3
TEACH_SENSITIVITY = 3


def normal_report(controller: Controller) -> bytes:
    """The report of port 30001."""
    return _with_size(_normal_body(controller))


def rich_report(controller: Controller, counter: int) -> bytes:
    """The report of port 30002, the one clients use by default."""
    turn = controller.tool.rotation.as_rotvec()
    body = _normal_body(controller)
    body += bytes([ARM_TYPE, AXES, 2, 2, 10, 11])
    body += FIRMWARE.encode().ljust(30, b"\0")
    body += pack_floats([1000.0, 1.0, 50000.0, 0.1, 1000.0])  # tool: jerk, acceleration and speed range (mm)
    body += pack_floats([20.0, 0.01, 20.0, 1e-4, np.pi])  # joints: the same (rad)
    body += pack_floats([2.3, 2.7])  # rotation: jerk, acceleration
    body += bytes(14 + 2)  # servo and tool status codes
    body += bytes([30] * 7)  # motor temperatures, Celsius
    body += pack_floats([controller.tool_speed, *[0.0] * 7])
    body += struct.pack(">I", counter)
    body += pack_floats([0.0] * 6)  # world offset
    body += bytes(5) + pack_floats([0.0] * 6)  # IO reset, simulation, collision model
    body += struct.pack(">7H", *[4800] * 7) + pack_floats([0.0] * 7)  # motor voltages (10 mV), currents
    body += bytes(2 + 16 + 32)  # control box IO
    body += pack_floats([0.0] * 12) + bytes(1)  # force sensor, identification progress
    body += pack_floats(turn) + bytes(2)  # orientation as axis-angle, configuration bits, reduced mode
    body += struct.pack(">6h", 9999, -9999, 9999, -9999, 9999, -9999)  # reduced mode: boundary, mm
    body += pack_floats([1000.0, np.pi, *[-2 * np.pi, 2 * np.pi] * 7])  # reduced mode: speeds, joint ranges
    body += bytes(2 + 4 + 1)  # fence, rebound, alarm, force sensor switch
    body += bytes(2 + 6)  # monitored external device: none
    return _with_size(body)


def real_report(controller: Controller) -> bytes:
    """The report of port 30003: motion only, no error codes."""
    return _with_size(_motion(controller) + pack_floats([0.0] * 12))


def _with_size(body: bytes) -> bytes:
    return struct.pack(">I", 4 + len(body)) + body


def _motion(controller: Controller) -> bytes:
    head = struct.pack(">BH", controller.state | controller.mode << 4, controller.queued)
    return head + pack_floats([*controller.joints, 0.0, *controller.tool.to_wire(), *[0.0] * 7])


def _normal_body(controller: Controller) -> bytes:
    enabled = sum(1 << axis for axis, on in enumerate(controller.motors) if on)
    if all(controller.motors):
        enabled = ALL_JOINT_BITS
    return (
        _motion(controller)
        + bytes([enabled, enabled, controller.error, controller.warning])
        + pack_floats(controller.tcp_offset.to_wire())
        + pack_floats([0.0] * 4)  # payload: mass, centre
        + bytes([COLLISION_SENSITIVITY, TEACH_SENSITIVITY])
        + pack_floats([0.0, 0.0, -1.0])  # gravity
    )
