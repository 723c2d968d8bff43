"""Registers that move the arm; numbers and parameters as xarm-python-sdk sends them."""

import struct
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from xarm_bridge.emulator.controller import Controller
from xarm_bridge.emulator.devices import Devices, Handler, finite_floats, flag, goal_floats, keeping
from xarm_bridge.emulator.motion import Place
from xarm_bridge.emulator.streaming import JointVelocity, ToolVelocity
from xarm_bridge.kinematics import JOINTS, Pose


def _pose(values: tuple[float, ...], *, axis_angle: int = 0) -> Pose:
    """From mm and either roll, pitch, yaw or a rotation vector in radians."""
    if axis_angle:
        return Pose(np.array(values[:3]), Rotation.from_rotvec(values[3:6]))
    return Pose.from_wire(values)


def _queue_or_check(
    controller: Controller, check_only: int, goal: Callable[[], Place], queue: Callable[[], None]
) -> bytes:
    """Queue a move, or only tell what going to its goal would end with; the reply to either."""
    if check_only:
        return struct.pack(">HB", len(controller.queue), controller.arm.trouble_at(goal()))
    queue()
    return struct.pack(">HB", len(controller.queue), 0)


def _line(devices: Devices, params: bytes) -> bytes:
    """Registers 21 and 22; the longer form adds radius, frame (0 base, 1 tool), axis-angle and check-only."""
    in_tool_frame, axis_angle, check_only = (flag(params, 40 + index) for index in range(3))
    may_keep = 0 if in_tool_frame or axis_angle else 6
    *target, speed, acceleration, _ = goal_floats(params, 9, may_keep)

    def goal_from(tool: Pose) -> Pose:
        if axis_angle or in_tool_frame:
            pose = _pose(tuple(target), axis_angle=axis_angle)
            return tool @ pose if in_tool_frame else pose
        return Pose.from_wire(tuple(keeping(tuple(target), tool.to_wire())))

    controller = devices.controller
    return _queue_or_check(
        controller,
        check_only,
        lambda: goal_from(controller.arm.tool),
        lambda: controller.line(goal_from, speed, acceleration),
    )


def _line_in_tool_frame(devices: Devices, params: bytes) -> bytes:
    values = finite_floats(params, 9)
    target = Pose.from_wire(values)
    devices.controller.line(lambda tool: tool @ target, values[6], values[7])
    return b""


def _circle(devices: Devices, params: bytes) -> bytes:
    """Two points, speed, acceleration, time, percent of the whole circle; flags as for a line."""
    values = finite_floats(params, 16)
    in_tool_frame, axis_angle, check_only = (flag(params, 64 + index) for index in range(3))
    points = _pose(values[:6], axis_angle=axis_angle), _pose(values[6:12], axis_angle=axis_angle)
    speed, acceleration, _, percent = values[12:]
    if percent <= 0:
        raise ValueError(f"a circle of {percent} percent")

    def points_from(tool: Pose) -> tuple[Pose, Pose]:
        return (tool @ points[0], tool @ points[1]) if in_tool_frame else points

    controller = devices.controller
    return _queue_or_check(
        controller,
        check_only,
        lambda: points_from(controller.arm.tool)[1],
        lambda: controller.circle(points_from, percent / 100, speed, acceleration),
    )


def _joints(devices: Devices, params: bytes) -> bytes:
    values = goal_floats(params, 10, JOINTS + 1)
    controller = devices.controller
    return _queue_or_check(
        controller,
        flag(params, 40),
        lambda: keeping(values[:JOINTS], controller.arm.joints),
        lambda: controller.turn_joints(lambda joints: keeping(values[:JOINTS], joints), values[7], values[8]),
    )


def _home(devices: Devices, params: bytes) -> bytes:
    speed, acceleration, _ = finite_floats(params, 3)
    controller = devices.controller
    return _queue_or_check(
        controller,
        flag(params, 12),
        lambda: np.zeros(JOINTS),
        lambda: controller.turn_joints(np.zeros_like, speed, acceleration),
    )


def _relative(devices: Devices, params: bytes) -> bytes:
    """A change of the joints or, in the base frame, of the TCP: of its coordinates, or a turn about fixed axes."""
    values = finite_floats(params, 11)
    change, speed, acceleration = np.array(values[:JOINTS]), values[7], values[8]
    of_joints, axis_angle, check_only = (flag(params, 44 + index) for index in range(3))
    controller = devices.controller

    def goal_from(tool: Pose) -> Pose:
        if axis_angle:
            return Pose(tool.position + change[:3], Rotation.from_rotvec(change[3:]) * tool.rotation)
        return Pose.from_wire(tuple(np.array(tool.to_wire()) + change))

    if of_joints:
        return _queue_or_check(
            controller,
            check_only,
            lambda: controller.arm.joints + change,
            lambda: controller.turn_joints(lambda joints: joints + change, speed, acceleration),
        )
    return _queue_or_check(
        controller,
        check_only,
        lambda: goal_from(controller.arm.tool),
        lambda: controller.line(goal_from, speed, acceleration),
    )


def _dwell(devices: Devices, params: bytes) -> bytes:
    (duration,) = finite_floats(params, 1)
    if duration < 0:
        raise ValueError(f"a pause of {duration} s")
    devices.controller.dwell(duration)
    return b""


def _servo_joints(devices: Devices, params: bytes) -> bytes:
    devices.controller.servo_joints_to(np.array(finite_floats(params, 10)[:JOINTS]))
    return b""


def _servo_line(devices: Devices, params: bytes) -> bytes:
    values = finite_floats(params, 9)
    target, in_tool_frame = Pose.from_wire(values), bool(values[8])
    devices.controller.servo_to(devices.controller.arm.tool @ target if in_tool_frame else target)
    return b""


def _joint_velocity(devices: Devices, params: bytes) -> bytes:
    """Seven speeds, whether joints shall reach them together (no matter here), and in the longer form a duration."""
    speeds = np.array(finite_floats(params, 7)[:JOINTS])
    devices.controller.move_at(JointVelocity(speeds), _duration(params[29:]))
    return b""


def _tool_velocity(devices: Devices, params: bytes) -> bytes:
    """Speeds along and about x, y, z, the frame (0 base, 1 tool), and in the longer form a duration."""
    values = np.array(finite_floats(params, 6))
    velocity = ToolVelocity(values[:3], values[3:], bool(flag(params, 24)))
    devices.controller.move_at(velocity, _duration(params[25:]))
    return b""


def _duration(params: bytes) -> float:
    return finite_floats(params, 1)[0] if params else 0.0


MOTION_HANDLERS: dict[int, Handler] = {
    21: _line,
    22: _line,
    23: _joints,
    24: _joints,
    25: _home,
    26: _dwell,
    27: _circle,
    28: _line_in_tool_frame,
    29: _servo_joints,
    30: _servo_line,
    81: _joint_velocity,
    82: _tool_velocity,
    83: _relative,
}
