"""A second arm, as a driver in one file: it goes where it is told at once, and keeps notes that others may read."""

import time

import numpy as np

from egophys_core.errors import ArmFaultError, ArmLostError, RobotError
from egophys_core.robot import ArmDriver, ArmIdentity, ArmState, Transform

REACH_M = 0.8
NOTES: dict[str, list[int]] = {}
"""What control boxes keep, by address: several drivers may be connected to one."""


class SecondArm(ArmDriver):
    """An arm without dynamics."""

    joint_names = ("shoulder", "elbow")
    stream_period = 0.005
    largest_pose_step = 0.02

    def __init__(self, address: str) -> None:
        self.address = address
        self.tcp = Transform.from_rpy(np.array([0.45, 0.0, 0.322]), np.array([np.pi, 0.0, 0.0]))
        self.streamed: list[Transform] = []
        self.error = 0
        self.is_lost = False
        self.is_streaming = False
        self.opening = 0.08

    def connect(self, *, patience: float = 0.0) -> ArmIdentity:
        if self.is_lost:
            raise RobotError(f"nobody at {self.address}")
        NOTES.setdefault(self.address, [0] * 32)
        return ArmIdentity(serial=f"SECOND{self.address}", address=self.address, is_emulator=True)

    def close(self) -> None:
        self.is_streaming = False

    def state(self) -> ArmState:
        self._require_answer()
        return ArmState(stamp_ns=time.time_ns(), tcp=self.tcp, joints=np.zeros(2))

    def error_code(self) -> int:
        self._require_answer()
        return self.error

    def describe_error(self, code: int) -> str:
        return f"error {code} of the second arm"

    def clear_error(self) -> None:
        self.error = 0

    def halt(self) -> None:
        self._require_answer()
        self.is_streaming = False

    def first_unreachable(self, poses):
        far = (index for index, pose in enumerate(poses) if np.linalg.norm(pose.translation) >= REACH_M)
        return next(far, None)

    def begin_streaming(self) -> None:
        self.is_streaming = True

    def stream(self, pose: Transform) -> None:
        self._require_answer()
        if self.error:
            raise ArmFaultError(self.describe_error(self.error))
        if not self.is_streaming:
            raise RobotError("the arm was halted")
        self.tcp = pose
        self.streamed.append(pose)

    def end_streaming(self) -> None:
        self.is_streaming = False

    def read_note(self, size: int) -> list[int]:
        self._require_answer()
        return NOTES[self.address][:size]

    def write_note(self, numbers: list[int]) -> None:
        self._require_answer()
        NOTES[self.address][: len(numbers)] = numbers

    def prepare_gripper(self) -> None:
        self._require_answer()

    def move_gripper(self, opening: float) -> None:
        self.opening = opening

    def gripper_opening(self) -> float:
        return self.opening

    def _require_answer(self) -> None:
        if self.is_lost:
            raise ArmLostError(f"no answer from {self.address}")
