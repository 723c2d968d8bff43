"""The real emulator as a process on an address of its own, and plans for the arm in front of it."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from egophys_core.robot import Calibration, MotionLimits, Transform
from egophys_core.waypoint_plan import WaypointPlan

PACKAGE = Path(__file__).resolve().parents[2] / "ros2_ws/src/xarm_bridge"

READY_TIMEOUT = 30.0
EXIT_TIMEOUT = 10.0
GRIPPER_DOWN = np.array([1.0, 0.0, 0.0, 0.0])

CALIBRATION = Calibration(
    world_to_base=Transform.from_rpy(np.array([0.45, 0.02, 0.0]), np.array([0.0, 0.0, 0.3])),
    tool=Transform(rotation=np.eye(3), translation=np.array([0.0, 0.0, 0.172])),
)
LIMITS = MotionLimits(workspace_min_m=(0.2, -0.4, 0.0), workspace_max_m=(0.65, 0.4, 0.5))


class EmulatorProcess:
    """One running emulator."""

    def __init__(self, host: str, arguments: tuple[str, ...]) -> None:
        self.host = host
        self._process = subprocess.Popen(
            [sys.executable, "-m", "xarm_bridge.emulator.server", "--host", host, *arguments],
            cwd=PACKAGE,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.greeting = self._next_line()
        assert "ready on" in self.greeting, f"emulator did not start: {self.greeting!r}"

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def inject(self, fault: str) -> str:
        """Let a fault happen now (start with --faults-from-stdin); the emulator's answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{fault}\n")
        self._process.stdin.flush()
        return self._next_line()

    def kill(self) -> None:
        self._process.kill()
        self._process.wait(EXIT_TIMEOUT)

    def interrupt(self) -> int:
        """Ctrl-C; the exit code."""
        self._process.send_signal(signal.SIGINT)
        return self._process.wait(EXIT_TIMEOUT)

    def close(self) -> None:
        if self.alive:
            self.kill()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()

    def _next_line(self) -> str:
        assert self._process.stdout is not None
        timer = threading.Timer(READY_TIMEOUT, self._process.kill)
        timer.start()
        line = self._process.stdout.readline()
        timer.cancel()
        return line


def loopback_addresses() -> Iterator[str]:
    """Addresses of this process alone, so that test runs side by side do not meet."""
    pid = os.getpid()
    for index in range(2, 255):
        yield f"127.{1 + pid // 256 % 254}.{pid % 256}.{index}"


def make_plan(positions: list[list[float]], times: list[float], opening: float = 0.08) -> WaypointPlan:
    """Waypoints in the world with the gripper pointing down."""
    return WaypointPlan(
        times=np.array(times),
        positions=np.array(positions),
        quaternions=np.tile(GRIPPER_DOWN, (len(times), 1)),
        gripper_opening=np.full(len(times), opening),
        twin_id="",
        predicted_cost=0.0,
    )


def wait_until(condition: Callable[[], bool], timeout: float, what: str) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not happen within {timeout} s"
        time.sleep(0.01)
