"""Modes, states and error codes of the controller, and the exceptions that end in them."""

import enum

from xarm_bridge.emulator.protocol import Status

MOTORS_LOSE_POWER = frozenset(range(1, 18))
"""Emergency stop and servo errors: the brakes close and motion_enable is needed again."""
KINEMATIC_ERROR = 21
JOINT_LIMIT_ERROR = 23
CIRCLE_ERROR = 32
BOUNDARY_ERROR = 35


class Mode(enum.IntEnum):
    """Modes emulated; a request for another one is answered as invalid."""

    POSITION = 0
    SERVO = 1
    JOINT_VELOCITY = 4
    TOOL_VELOCITY = 5


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


class MotionError(Exception):
    """Motion that ends in a controller error."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code
