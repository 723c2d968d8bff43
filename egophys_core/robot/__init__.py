"""Robot room: frames, sim-to-robot calibration, workspace and motion limits. Imports no ROS and no SDK."""

from egophys_core.robot.calibration import Calibration, CalibrationRecord
from egophys_core.robot.calibration_fit import FitQuality, FitReport, fit_world_to_base
from egophys_core.robot.frames import Transform, quaternions_from_rpy, rpy_from_quaternions
from egophys_core.robot.limits import MotionLimits, check_plan
from egophys_core.robot.path import PlannedPath, StraightMove
from egophys_core.robot.touched_pairs import TouchedPairs, read_touched_pairs

__all__ = [
    "Calibration",
    "CalibrationRecord",
    "FitQuality",
    "FitReport",
    "MotionLimits",
    "PlannedPath",
    "StraightMove",
    "TouchedPairs",
    "Transform",
    "check_plan",
    "fit_world_to_base",
    "quaternions_from_rpy",
    "read_touched_pairs",
    "rpy_from_quaternions",
]
