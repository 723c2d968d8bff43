"""`egophys execute PLAN --robot-ip IP --calibration FILE`."""

import argparse
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

from egophys_core.cli.display import progress_bar
from egophys_core.errors import RobotError

if TYPE_CHECKING:
    from egophys_core.robot import PlanExecutor
    from egophys_core.waypoint_plan import WaypointPlan

DRIVER = "xarm_bridge.xarm6:XArm6"
MAX_AGE_S = 300.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("plan", type=Path, metavar="PLAN", help="file that `egophys plan` wrote")
    parser.add_argument("--robot-ip", required=True, metavar="IP", help="address of the arm's control box")
    parser.add_argument(
        "--calibration", required=True, type=Path, metavar="YAML", help="where the robot stands (egophys calibrate)"
    )
    parser.add_argument(
        "--params-file", type=Path, metavar="YAML", help="limits, as the bridge's parameters (default: its defaults)"
    )
    parser.add_argument("--max-age", type=_age, default=MAX_AGE_S, metavar="S", help="of the plan; 0 for any age")
    parser.add_argument("--check", action="store_true", help="judge the plan from where the arm stands; move nothing")
    parser.add_argument("--allow-emulator", action="store_true", help="take an emulated control box for the arm")
    parser.add_argument("--no-gripper", action="store_true", help="do not move a gripper")
    parser.add_argument("--driver", default=DRIVER, help="module:Class of the arm's driver (default %(default)s)")


def run(parsed: argparse.Namespace) -> int:
    """Execute; 1 if it was stopped before the end of the plan."""
    from egophys_core.plan_file import read_plan
    from egophys_core.robot import (
        ArmLink,
        Calibration,
        LinkEvents,
        MotionLimits,
        Origin,
        Ownership,
        PlanExecutor,
        check_origin,
        load_driver,
    )

    file = read_plan(parsed.plan)
    check_origin(
        file.plan, file.stamp_ns, time.time_ns(), Origin(twin_id="", max_age=parsed.max_age, max_age_name="--max-age")
    )
    limits = MotionLimits.load(parsed.params_file) if parsed.params_file else MotionLimits()
    calibration = Calibration.load(parsed.calibration)
    driver = load_driver(parsed.driver, parsed.robot_ip)
    try:
        identity = driver.connect()
        if identity.is_emulator and not parsed.allow_emulator:
            raise RobotError(f"what answers at {parsed.robot_ip} is an emulator; give --allow-emulator to use it")
        ownership = Ownership(driver, identity.serial, "egophys execute")
        executor = PlanExecutor(
            driver,
            calibration=calibration,
            limits=limits,
            has_gripper=not parsed.no_gripper,
            require_permit=ownership.require,
        )
        if parsed.check:
            executor.check(file.plan)
            print(f"{parsed.plan} may be executed: {len(file.plan.times)} waypoints over {file.plan.times[-1]:.1f} s")
            return 0
        ownership.acquire()
        link = ArmLink(driver, executor.measured, ownership, LinkEvents())
        try:
            return _execute(executor, file.plan)
        finally:
            link.close()
            ownership.release()
    finally:
        driver.close()


def _age(text: str) -> float:
    """Seconds from the command line.

    Raises:
        argparse.ArgumentTypeError: it is no finite number from 0 on.
    """
    try:
        age = float(text)
    except ValueError:
        age = math.nan
    if not 0.0 <= age < math.inf:
        raise argparse.ArgumentTypeError(f"must be seconds from 0 on, 0 for any age, got {text!r}")
    return age


def _execute(executor: "PlanExecutor", plan: "WaypointPlan") -> int:
    import numpy as np

    with progress_bar() as report:
        executed = executor.execute(plan, on_progress=lambda share, pose: report("execute", share))
    if not executed.completed:
        print("stopped before the end of the plan")
        return 1
    apart = float(np.linalg.norm(executed.positions[-1] - plan.positions[-1]))
    print(f"executed in {executed.times[-1]:.1f} s; the tool stands {1000 * apart:.1f} mm from the last waypoint")
    return 0
