"""What the registers of the command port act on, and how their parameters are read."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from xarm_bridge.emulator.controller import Controller
from xarm_bridge.emulator.gripper import Gripper
from xarm_bridge.emulator.protocol import unpack_floats

LARGEST = 1e6
"""Beyond it no parameter means anything for an arm of 0.7 m (mm, degrees, seconds)."""


@dataclass(frozen=True, kw_only=True)
class Devices:
    """What the registers act on."""

    serial: str
    """Serial number of the arm."""
    controller: Controller
    gripper: Gripper
    named: set[int] = field(default_factory=set)
    """Registers without emulation that were named in the log."""


Handler = Callable[[Devices, bytes], bytes]
"""Carries out a request; takes and gives parameters without the header.

ValueError, IndexError and struct.error mean parameters that are none, RefusedError a command that is refused.
"""


def finite_floats(params: bytes, count: int) -> tuple[float, ...]:
    """The first `count` floats.

    Raises:
        ValueError: too few, or one that is not finite or far too large.
    """
    return goal_floats(params, count, 0)


def goal_floats(params: bytes, count: int, axes: int) -> tuple[float, ...]:
    """Like `finite_floats`, but the first `axes` may be infinite: such an axis keeps its value."""
    values = unpack_floats(params, count)
    if not all(abs(value) <= LARGEST or (np.isinf(value) and index < axes) for index, value in enumerate(values)):
        raise ValueError(f"parameters must be at most {LARGEST:g} or, of axes, infinite, got {values}")
    return values


def keeping(goal: tuple[float, ...], present: Iterable[float]) -> np.ndarray:
    """The goal with the present value of every axis that shall keep it."""
    return np.where(np.isinf(goal), np.fromiter(present, float), goal)


def flag(params: bytes, index: int) -> int:
    """A byte of the parameters, 0 where a shorter request ends before it."""
    return params[index] if len(params) > index else 0
