"""Where the robot stands in the world: the calibrated transform, its file, and how to find it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from egophys_core.errors import RobotError
from egophys_core.files import write_atomically
from egophys_core.geometry import rigid_fit
from egophys_core.robot.frames import Transform
from egophys_core.robot.yaml_mapping import check_keys, load_mapping, number_array

UNIT_QUATERNION_TOLERANCE = 1e-3
"""How far a hand-written quaternion's length may be from 1; three printed decimals pass."""

SMALLEST_TRIANGLE_M = 0.01
"""Points that lie closer than this to one line do not fix the rotation about it."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The frames between a plan in the world and what the controller is sent."""

    world_to_base: Transform
    """p_base = R p_world + t; base is the xArm's own base frame."""
    tool: Transform = field(default_factory=Transform.identity)
    """Pose of the planned tool point in the TCP frame that the controller reports (fingertips, say)."""

    @classmethod
    def load(cls, path: Path) -> "Calibration":
        """Read the YAML file.

        Raises:
            RobotError: unreadable, unknown or missing key, number not finite, quaternion not unit.
        """
        content = load_mapping(path)
        check_keys(content, str(path), required=("world_to_base",), optional=("tool",))
        world_to_base = _transform_from(content["world_to_base"], f"{path}: world_to_base")
        if "tool" not in content:
            return cls(world_to_base=world_to_base)
        return cls(world_to_base=world_to_base, tool=_transform_from(content["tool"], f"{path}: tool"))

    def save(self, path: Path) -> None:
        """Write the YAML file atomically; `load` gives the same calibration back."""
        content = {"world_to_base": _mapping_from(self.world_to_base), "tool": _mapping_from(self.tool)}
        write_atomically(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None).encode())

    def tcp_in_base(self, tool_in_world: Transform) -> Transform:
        """The TCP pose to command so that the tool point has this pose in the world."""
        return self.world_to_base @ tool_in_world @ self.tool.inverse()

    def tool_in_world(self, tcp_in_base: Transform) -> Transform:
        """Where the tool point is in the world when the controller reports this TCP pose."""
        return self.world_to_base.inverse() @ tcp_in_base @ self.tool


@dataclass(frozen=True, kw_only=True)
class FitReport:
    """A fitted transform and how well it explains the point pairs it was fitted to."""

    world_to_base: Transform
    """Least-squares rigid transform from world to base."""
    residuals: np.ndarray
    """[N] float64, distance between each moved world point and its base point, metres."""

    @property
    def rms(self) -> float:
        """Root mean square residual, metres; a careful touch-off of a table corner gives 1 to 3 mm."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fit_world_to_base(world_points: np.ndarray, base_points: np.ndarray) -> FitReport:
    """Fit the calibration from points known in both frames (touch them with the tool, read its position).

    W. Kabsch, Acta Cryst. A32 (1976) 922: the rotation that minimises the summed squared distances.

    Args:
        world_points: [N, 3] metres, N >= 3, not all on one line.
        base_points: [N, 3] metres, the same points in the robot base frame, same order.

    Raises:
        RobotError: shapes differ, too few points, a number not finite, or the points lie on one line.
    """
    world = np.asarray(world_points, dtype=np.float64)
    base = np.asarray(base_points, dtype=np.float64)
    if world.shape != base.shape or world.ndim != 2 or world.shape[1] != 3 or len(world) < 3:
        raise RobotError(f"calibration needs two lists [N, 3] with N >= 3, got {world.shape} and {base.shape}")
    if not (np.isfinite(world).all() and np.isfinite(base).all()):
        raise RobotError("calibration points must be finite; remove the pair with NaN or infinity")
    for label, points in (("world", world), ("base", base)):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(world))
        if spread < SMALLEST_TRIANGLE_M:
            raise RobotError(
                f"the {label} points lie within {spread * 1000:.1f} mm of one line, so the rotation about it "
                f"is unknown; touch points that span at least {SMALLEST_TRIANGLE_M * 1000:.0f} mm"
            )
    rotation, translation = rigid_fit(world, base)
    world_to_base = Transform(rotation=rotation, translation=translation)
    residuals = np.linalg.norm(world_to_base.apply(world) - base, axis=1)
    return FitReport(world_to_base=world_to_base, residuals=residuals)


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


def _mapping_from(transform: Transform) -> dict[str, list[float]]:
    return {
        "translation_m": transform.translation.tolist(),
        "quaternion_xyzw": transform.quaternion.tolist(),
    }
