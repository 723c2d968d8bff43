"""What a driver of an arm does: the one interface between plans and a robot. A second arm is one more file.

Poses are those of the controller's TCP in the robot base frame, metres. Where the tool point is in the world is the
business of `Calibration`; whether a pose may be sent is that of `PlanExecutor`.
"""

import importlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.errors import RobotError
from egophys_core.robot.frames import Transform


@dataclass(frozen=True, kw_only=True)
class ArmIdentity:
    """Which arm answered."""

    serial: str
    """Of the arm; the same on every connection to it, and of no other arm."""
    address: str
    """That was connected to."""
    is_emulator: bool
    """Nothing real moves."""


@dataclass(frozen=True, kw_only=True)
class ArmState:
    """What the controller measured."""

    stamp_ns: int
    """When, nanoseconds since the epoch."""
    tcp: Transform
    """Pose of the TCP in the robot base frame."""
    joints: np.ndarray
    """[J] float64, angles in the order of `ArmDriver.joint_names`, radians."""


class ArmDriver(ABC):
    """An arm and its gripper. Methods may be called from several threads, and each is bounded in time.

    Every method but `connect` and `close` raises ArmLostError where the controller does not answer, ArmFaultError
    where it is in an error state, and RobotError where it refuses.
    """

    joint_names: tuple[str, ...]
    """As in the arm's URDF."""
    stream_period: float
    """Seconds between streamed poses."""
    largest_pose_step: float
    """Metres between streamed poses, beyond which the controller does not follow."""

    @abstractmethod
    def __init__(self, address: str) -> None:
        """Connect to nothing yet; `address` is that of the arm's control box."""

    @abstractmethod
    def connect(self, *, patience: float = 0.0) -> ArmIdentity:
        """Connect to the controller; nothing moves. A lost connection is made anew.

        Args:
            patience: seconds to keep trying while nobody listens (the box may be starting).

        Raises:
            RobotError: no controller there, or one that cannot be used.
        """

    @abstractmethod
    def close(self) -> None:
        """Disconnect; the arm stays as it is."""

    @abstractmethod
    def state(self) -> ArmState:
        """Where the arm is now."""

    @abstractmethod
    def error_code(self) -> int:
        """The controller's error code now, 0 if none."""

    @abstractmethod
    def describe_error(self, code: int) -> str:
        """An error code in words, with what to do."""

    @abstractmethod
    def clear_error(self) -> None:
        """Clear the error; the arm stays stopped. Raises RobotError if the error stays."""

    @abstractmethod
    def halt(self) -> None:
        """Stop the arm now and have the controller confirm it."""

    @abstractmethod
    def first_unreachable(self, poses: Sequence[Transform]) -> int | None:
        """Which of poses the arm cannot go to, one after the other from where it stands; None if it can. Nothing moves.

        Args:
            poses: close to each other, so that joints that would have to jump are noticed.
        """

    @abstractmethod
    def begin_streaming(self) -> None:
        """Let streamed poses move the arm, which does not move yet."""

    @abstractmethod
    def stream(self, pose: Transform) -> None:
        """Newest pose to go to."""

    @abstractmethod
    def end_streaming(self) -> None:
        """Leave the arm as other programs expect it."""

    @abstractmethod
    def read_note(self, size: int) -> list[int]:
        """The first `size` numbers (0 to 65535) that the control box keeps for its users, alike for every client.

        Raises:
            RobotError: it keeps none.
            ArmLostError: it does not answer.
        """

    @abstractmethod
    def write_note(self, numbers: list[int]) -> None:
        """Set those numbers; raises as `read_note`."""

    @abstractmethod
    def prepare_gripper(self) -> None:
        """Enable the gripper; it does not move."""

    @abstractmethod
    def move_gripper(self, opening: float) -> None:
        """Start opening or closing to `opening` metres between the fingers; does not wait."""

    @abstractmethod
    def gripper_opening(self) -> float:
        """Measured distance between the fingers, metres."""


def load_driver(name: str, address: str) -> ArmDriver:
    """The driver of an arm, not connected yet.

    Args:
        name: `module:Class` of a subclass of `ArmDriver` whose constructor takes an address.
        address: of the arm's control box.

    Raises:
        RobotError: there is no such driver, or it does not take the address.
    """
    module_name, _, class_name = name.partition(":")
    try:
        kind = getattr(importlib.import_module(module_name), class_name)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise RobotError(
            f"no driver {name!r} ({error}); give module:Class, for an xArm6 xarm_bridge.xarm6:XArm6 with the workspace "
            "sourced"
        ) from error
    if not (isinstance(kind, type) and issubclass(kind, ArmDriver)):
        raise RobotError(f"{name} is no subclass of egophys_core.robot.ArmDriver")
    if lacking := sorted(kind.__abstractmethods__):
        raise RobotError(f"the driver {name} lacks {', '.join(lacking)} of egophys_core.robot.ArmDriver; write them")
    return kind(address)
