"""What clients commanded and what the arm did, one JSON object a line, for those who check from outside.

Command lines: {"t", "register", "name", "accepted", parameters..., "tool_mm", "rpy_rad"}
Change lines:  {"t", "name": "changed", "state", "mode", "error", "warning", "motors_on", "tool_mm", "rpy_rad"}

`t` is Unix time in seconds, `name` the SDK's name of the register in small letters, parameters as sent (mm, rad, s;
null for an axis that keeps its value), `accepted` false for a command that was answered but not carried out, `tool_mm`
[3] and `rpy_rad` [3] the TCP pose in the robot base after the command was taken in. A change line follows every change
of state, mode, error, warning or motor power, so the last pose of a motion is on the line where the state leaves 1.
"""

import json
import math
import struct
import time
from dataclasses import dataclass
from typing import Any, TextIO

from xarm_bridge.emulator.controller import Controller

FLUSH_INTERVAL = 1.0
"""Seconds; a killed emulator loses the lines since."""

LINE = (("target_mm", 3), ("orientation_rad", 3), ("speed_mm_s", 1), ("acceleration_mm_s2", 1), ("time_s", 1))
JOINTS = (("joints_rad", 7), ("speed_rad_s", 1), ("acceleration_rad_s2", 1), ("time_s", 1))


@dataclass(frozen=True)
class Layout:
    """Parameters of a register: float32 values first, bytes behind them; a shorter request has the first of them."""

    name: str
    floats: tuple[tuple[str, int], ...] = ()
    """Name and number of values."""
    flags: tuple[str, ...] = ()

    def decode(self, params: bytes) -> dict[str, Any]:
        """Names and values of the parameters that are there."""
        values: dict[str, Any] = {}
        offset = 0
        for name, count in self.floats:
            if offset + 4 * count > len(params):
                return values
            numbers = [
                number if math.isfinite(number) else None for number in struct.unpack_from(f"<{count}f", params, offset)
            ]
            values[name] = numbers if count > 1 else numbers[0]
            offset += 4 * count
        values.update(zip(self.flags, params[offset:], strict=False))
        return values


COMMANDS = {
    11: Layout("motion_en", (), ("axis", "enable")),
    12: Layout("set_state", (), ("state",)),
    16: Layout("clean_err"),
    17: Layout("clean_war"),
    19: Layout("set_mode", (), ("mode",)),
    21: Layout("move_line", (*LINE, ("radius_mm", 1)), ("in_tool_frame", "axis_angle", "check_only")),
    22: Layout("move_lineb", (*LINE, ("radius_mm", 1)), ("check_only",)),
    23: Layout("move_joint", JOINTS, ("check_only",)),
    24: Layout("move_jointb", (*JOINTS[:3], ("radius_mm", 1)), ("check_only",)),
    25: Layout("move_home", JOINTS[1:], ("check_only",)),
    28: Layout("move_line_tool", LINE, ("check_only",)),
    29: Layout("move_servoj", JOINTS),
    30: Layout("move_servo_cart", (*LINE[:4], ("in_tool_frame", 1))),
    35: Layout("set_tcp_offset", (("offset_mm", 3), ("offset_rpy_rad", 3))),
    83: Layout("move_relative", (("change", 7), *LINE[2:], ("radius_mm", 1)), ("joints", "axis_angle", "check_only")),
}
"""Registers that move the arm, or decide whether and how it may move."""


class Journal:
    """Writes the lines; buffered, flushed every second and at the end."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._flushed = time.monotonic()
        self._last_condition: dict[str, Any] = {}

    def command(self, controller: Controller, register: int, params: bytes, *, accepted: bool) -> None:
        """Write a request down if it is one of `COMMANDS`."""
        layout = COMMANDS.get(register)
        if layout is None:
            return
        told = {"register": register, "name": layout.name, "accepted": accepted, **layout.decode(params)}
        self._write(told, controller)

    def notice_changes(self, controller: Controller) -> None:
        """Write a line if something changed since the last call."""
        condition = {
            "state": int(controller.state),
            "mode": int(controller.mode),
            "error": controller.error,
            "warning": controller.warning,
            "motors_on": all(controller.motors),
        }
        if condition != self._last_condition:
            self._last_condition = condition
            self._write({"name": "changed", **condition}, controller)
        if time.monotonic() - self._flushed > FLUSH_INTERVAL:
            self._flushed = time.monotonic()
            self._file.flush()

    def _write(self, told: dict[str, Any], controller: Controller) -> None:
        pose = [round(value, 6) for value in controller.tool.to_wire()]
        line = {"t": round(time.time(), 6), **told, "tool_mm": pose[:3], "rpy_rad": pose[3:]}
        self._file.write(json.dumps(line) + "\n")
