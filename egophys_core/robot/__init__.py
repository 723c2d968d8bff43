"""Robot room: frames, sim-to-robot calibration, workspace and motion limits. Imports no ROS and no SDK."""

from egophys_core.robot.calibration import Calibration, FitReport, fit_world_to_base
from egophys_core.robot.frames import Transform, quaternions_from_rpy, rpy_from_quaternions
from egophys_core.robot.limits import MotionLimits, check_plan
from egophys_core.robot.path import PlannedPath, StraightMove

__all__ = [
    "Calibration",
    "FitReport",
    "MotionLimits",
    "PlannedPath",
    "StraightMove",
    "Transform",
    "check_plan",
    "fit_world_to_base",
    "quaternions_from_rpy",
    "rpy_from_quaternions",
]
