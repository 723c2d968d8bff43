"""Robot room: frames, calibration, motion limits, the interface of an arm, execution. Imports no ROS and no SDK."""

from egophys_core.robot.arm_driver import ArmDriver, ArmIdentity, ArmState, load_driver
from egophys_core.robot.arm_link import ArmLink, LinkEvents
from egophys_core.robot.calibration import CALIBRATION_FILE, Calibration, CalibrationRecord
from egophys_core.robot.calibration_fit import FitQuality, FitReport, fit_world_to_base
from egophys_core.robot.executed import ExecutedMotion
from egophys_core.robot.execution import Clock, PlanExecutor
from egophys_core.robot.frames import Transform, quaternions_from_rpy, rpy_from_quaternions
from egophys_core.robot.limits import MotionLimits, check_plan
from egophys_core.robot.ownership import ArmTakenError, Ownership
from egophys_core.robot.path import PlannedPath, StraightMove
from egophys_core.robot.plan_origin import Origin, check_origin
from egophys_core.robot.touched_pairs import TouchedPairs, read_touched_pairs

__all__ = [
    "CALIBRATION_FILE",
    "ArmDriver",
    "ArmIdentity",
    "ArmLink",
    "ArmState",
    "ArmTakenError",
    "Calibration",
    "CalibrationRecord",
    "Clock",
    "ExecutedMotion",
    "FitQuality",
    "FitReport",
    "LinkEvents",
    "MotionLimits",
    "Origin",
    "Ownership",
    "PlanExecutor",
    "PlannedPath",
    "StraightMove",
    "TouchedPairs",
    "Transform",
    "check_origin",
    "check_plan",
    "fit_world_to_base",
    "load_driver",
    "quaternions_from_rpy",
    "read_touched_pairs",
    "rpy_from_quaternions",
]
