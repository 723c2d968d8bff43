"""Where the robot stands in the world: the calibrated transform, its file, and how to find it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from egophys_core.errors import RobotError
from egophys_core.files import FileKind, write_atomically
from egophys_core.robot.frames import Transform
from egophys_core.robot.yaml_mapping import check_keys, load_mapping, number_array

UNIT_QUATERNION_TOLERANCE = 1e-3
"""How far a hand-written quaternion's length may be from 1; three printed decimals pass."""

CALIBRATION_FILE = FileKind(name="a calibration of the robot", head=rb".*^world_to_base:")


@dataclass(frozen=True, kw_only=True)
class CalibrationRecord:
    """How a calibration came about; nothing is computed from it."""

    date_utc: str
    """When it was fitted, ISO 8601."""
    rms_m: float
    """Root mean square residual of the points used."""
    leave_one_out_m: float
    """Root mean square distance of a point from where the fit to the others has it; NaN for three points."""
    residuals_m: dict[str, float]
    """Of each point used, by its name."""
    left_out_m: dict[str, float]
    """Distances of the points that were left out as mis-touched."""

    def to_mapping(self) -> dict[str, Any]:
        """As YAML types; numbers to a micrometre."""
        return {
            "date_utc": self.date_utc,
            "points": len(self.residuals_m),
            "rms_m": round(self.rms_m, 6),
            "leave_one_out_m": round(self.leave_one_out_m, 6),
            "residuals_m": {name: round(each, 6) for name, each in self.residuals_m.items()},
            "left_out_m": {name: round(each, 6) for name, each in self.left_out_m.items()},
        }


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The frames between a plan in the world and what the controller is sent."""

    world_to_base: Transform
    """p_base = R p_world + t; base is the xArm's own base frame."""
    tool: Transform = field(default_factory=Transform.identity)
    """Pose of the planned tool point in the TCP frame that the controller reports (fingertips, say)."""
    record: CalibrationRecord | None = None
    """None for one that was written by hand."""

    @classmethod
    def load(cls, path: Path) -> "Calibration":
        """Read the YAML file.

        Raises:
            RobotError: unreadable, unknown or missing key, number not finite, quaternion not unit.
        """
        content = load_mapping(path)
        check_keys(content, str(path), required=("world_to_base",), optional=("tool", "fit"))
        world_to_base = _transform_from(content["world_to_base"], f"{path}: world_to_base")
        tool = _transform_from(content["tool"], f"{path}: tool") if "tool" in content else Transform.identity()
        record = _record_from(content["fit"], f"{path}: fit") if "fit" in content else None
        return cls(world_to_base=world_to_base, tool=tool, record=record)

    def save(self, path: Path) -> None:
        """Write the YAML file atomically; `load` gives the same calibration back."""
        content: dict[str, Any] = {
            "world_to_base": _mapping_from(self.world_to_base),
            "tool": _mapping_from(self.tool),
        }
        if self.record is not None:
            content["fit"] = self.record.to_mapping()
        write_atomically(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None).encode())

    def tcp_in_base(self, tool_in_world: Transform) -> Transform:
        """The TCP pose to command so that the tool point has this pose in the world."""
        return self.world_to_base @ tool_in_world @ self.tool.inverse()

    def tool_in_world(self, tcp_in_base: Transform) -> Transform:
        """Where the tool point is in the world when the controller reports this TCP pose."""
        return self.world_to_base.inverse() @ tcp_in_base @ self.tool


def _transform_from(mapping: Any, where: str) -> Transform:
    check_keys(mapping, where, required=("translation_m", "quaternion_xyzw"))
    translation = number_array(mapping["translation_m"], f"{where}.translation_m", 3)
    quaternion = number_array(mapping["quaternion_xyzw"], f"{where}.quaternion_xyzw", 4)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > UNIT_QUATERNION_TOLERANCE:
        raise RobotError(
            f"{where}.quaternion_xyzw has length {length:.4f}, must be 1; divide it by its length "
            "(and check the order: x, y, z, w)"
        )
    return Transform.from_quaternion(translation, quaternion)


def _record_from(mapping: Any, where: str) -> CalibrationRecord:
    check_keys(
        mapping,
        where,
        required=("date_utc", "points", "rms_m", "leave_one_out_m", "residuals_m"),
        optional=("left_out_m",),
    )
    rms, leave_one_out = (_number_in(mapping, key, where) for key in ("rms_m", "leave_one_out_m"))
    return CalibrationRecord(
        date_utc=str(mapping["date_utc"]),
        rms_m=rms,
        leave_one_out_m=leave_one_out,
        residuals_m=_numbers_by_name(mapping["residuals_m"], f"{where}.residuals_m"),
        left_out_m=_numbers_by_name(mapping.get("left_out_m", {}), f"{where}.left_out_m"),
    )


def _numbers_by_name(mapping: Any, where: str) -> dict[str, float]:
    if not isinstance(mapping, dict):
        raise RobotError(f"{where} must be a mapping from points to metres, got {mapping!r}")
    return {str(name): _number_in(mapping, name, where) for name in mapping}


def _number_in(mapping: dict[str, Any], key: str, where: str) -> float:
    value = mapping[key]
    if not isinstance(value, int | float):
        raise RobotError(f"{where}.{key} must be a number, got {value!r}")
    return float(value)


def _mapping_from(transform: Transform) -> dict[str, list[float]]:
    return {
        "translation_m": transform.translation.tolist(),
        "quaternion_xyzw": transform.quaternion.tolist(),
    }
