"""Hostile plans against the real executor, the real SDK and the wire of an emulator that is faster than life."""

import itertools
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings

from benchmarks.hostile_plans import BASE_IN_WORLD_MM, BOX_HIGH_MM, BOX_LOW_MM, TOOL_MM, plans, unsafe_commands
from egophys_core.errors import ArmFaultError, ArmLostError, PlanningError, RobotError
from egophys_core.robot import ArmDriver, Calibration, Clock, MotionLimits, PlanExecutor, Transform, load_driver
from egophys_core.waypoint_plan import WaypointPlan

SPEEDUP = 100
"""Of the emulated arm, so that it stands where it was told before the next pose comes."""
STREAM_PERIOD = 0.02
"""The longest that the executor lets a plan go on between two poses: the steps are the largest that it ever sends."""
LONGEST_S = 20.0
"""Plans that take longer are hostile by their length alone; the stretch that is wanted here is short."""
PACKAGE = Path(__file__).resolve().parents[1] / "ros2_ws/src/xarm_bridge"


class RunningClock:
    """A clock that only sleep moves on."""

    def __init__(self) -> None:
        self._now = 0.0

    def clock(self) -> Clock:
        """For the executor."""
        return Clock(now=lambda: self._now, sleep=self._sleep)

    def _sleep(self, seconds: float) -> None:
        self._now += seconds


@contextmanager
def arm_on_emulator(address: str, wire: Path) -> Iterator[tuple[ArmDriver, PlanExecutor]]:
    """Driver and executor in front of an emulator of its own, whose wire is written down when the block has ended."""
    command = [sys.executable, "-m", "xarm_bridge.emulator.server", "--host", address, "--wire", str(wire)]
    start = ["--speedup", str(SPEEDUP), "--start", "450", "0", "322", "180", "0", "0"]
    with ExitStack() as stack:
        emulator = stack.enter_context(
            subprocess.Popen([*command, *start], cwd=PACKAGE, stdout=subprocess.PIPE, text=True)
        )
        stack.callback(emulator.terminate)
        assert emulator.stdout is not None
        assert "ready on" in emulator.stdout.readline()
        driver = load_driver("xarm_bridge.xarm6:XArm6", address)
        stack.callback(driver.close)
        driver.connect()
        driver.stream_period = STREAM_PERIOD
        clock = RunningClock().clock()
        yield driver, PlanExecutor(driver, calibration=_calibration(), limits=_limits(), clock=clock)


def try_plan(driver: ArmDriver, executor: PlanExecutor, plan: WaypointPlan) -> str:
    """What became of a plan: executed, refused, too long, or the error that should not have been."""
    if np.isfinite(plan.times).all() and plan.times[-1] > LONGEST_S:
        return "too long"
    try:
        return "executed" if executor.execute(plan).completed else "stopped"
    except (ArmFaultError, ArmLostError) as error:
        driver.clear_error()
        return f"failed: {error}"
    except (RobotError, PlanningError):
        return "refused"


def measure(count: int, address: str) -> dict[str, Any]:
    """Try `count` plans; what became of them, and the commands that were unsafe."""
    outcomes: Counter[str] = Counter()
    with TemporaryDirectory() as folder:
        wire = Path(folder) / "wire.jsonl"
        with arm_on_emulator(address, wire) as (driver, executor):
            numbers = itertools.count()

            @settings(max_examples=count, deadline=None, database=None, suppress_health_check=list(HealthCheck))
            @given(plans())
            def try_all(plan: WaypointPlan) -> None:
                outcomes[try_plan(driver, executor, plan)] += 1
                if next(numbers) % 500 == 0:
                    print(dict(outcomes), flush=True)

            try_all()
        unsafe = unsafe_commands(wire)
    return {"outcomes": dict(outcomes), "unsafe": unsafe}


def _calibration() -> Calibration:
    return Calibration(
        world_to_base=Transform(rotation=np.eye(3), translation=-BASE_IN_WORLD_MM / 1000.0),
        tool=Transform(rotation=np.eye(3), translation=TOOL_MM / 1000.0),
    )


def _limits() -> MotionLimits:
    low, high = (tuple((corner / 1000.0).tolist()) for corner in (BOX_LOW_MM, BOX_HIGH_MM))
    return MotionLimits(workspace_min_m=low, workspace_max_m=high)
