"""What the arm may be asked to do; a plan is judged as a whole before anything moves."""

from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.errors import OptionsError, RobotError
from egophys_core.options import from_mapping, number, validate
from egophys_core.robot.frames import Transform
from egophys_core.robot.tilt import steepest_between, tilt_of
from egophys_core.robot.yaml_mapping import load_mapping, number_array
from egophys_core.waypoint_plan import (
    RELATIVE_ROUNDING,
    SHORTEST_INTERVAL_S,
    WIDEST_GRIPPER_M,
    WaypointPlan,
    waypoint_name,
    why_no_motion,
)

ROS_KEY = "ros__parameters"
ALIKE = 0.8
"""Likeness of two names (difflib's) from which one is taken for a misspelling of the other."""

MEASURED_SLACK = 2e-3
"""Metres and radians that a measured pose may be beyond a limit: an arm that was sent to the very edge of its box
stands a rounding error outside, and has to be able to leave."""


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Workspace box and motion limits of the tool point. The box is in the robot base frame.

    Raises:
        OptionsError: a value is out of range, or the box is empty.
    """

    workspace_min_m: tuple[float, float, float] = field(
        default=(0.2, -0.4, 0.0),
        metadata={"doc": "lowest x, y, z of the tool point in the robot base frame, metres"},
    )
    workspace_max_m: tuple[float, float, float] = field(
        default=(0.65, 0.4, 0.5),
        metadata={"doc": "highest x, y, z of the tool point in the robot base frame, metres"},
    )
    max_speed_m_s: float = number(
        0.25, low=0.005, high=0.5, doc="tool point speed; 0.25 is the reduced speed of ISO 10218-1"
    )
    max_acceleration_m_s2: float = number(
        5.0,
        low=0.05,
        high=20.0,
        doc="change of velocity between segments (rest at both ends) over their mean time",
    )
    max_angular_speed_rad_s: float = number(1.0, low=0.05, high=3.0, doc="rotation speed of the tool")
    max_step_m: float = number(0.5, low=0.01, high=2.0, doc="distance between two waypoints")
    max_tilt_rad: float = number(
        1.0, low=0.0, high=3.2, doc="angle between the tool's z axis and straight down; 3.2 allows every orientation"
    )
    table_clearance_m: float = number(
        0.0, low=-0.05, high=0.5, doc="height above the table, z = 0 of the world, that the tool point keeps"
    )
    min_interval_s: float = number(0.02, low=SHORTEST_INTERVAL_S, high=10.0, doc="shortest time between waypoints")
    max_gripper_opening_m: float = number(
        0.085, low=0.001, high=WIDEST_GRIPPER_M, doc="stroke of the gripper; the xArm gripper's is 0.085"
    )

    def __post_init__(self) -> None:
        validate(self)
        corners = self.workspace_min_m + self.workspace_max_m
        if len(corners) != 6 or not np.isfinite(corners).all():
            raise OptionsError(
                f"workspace corners must be 3 finite numbers each, got {self.workspace_min_m} "
                f"and {self.workspace_max_m}"
            )
        for axis, low, high in zip("xyz", self.workspace_min_m, self.workspace_max_m, strict=True):
            if not low < high:
                raise OptionsError(f"workspace is empty along {axis}: from {low} m to {high} m; swap or widen them")

    @classmethod
    def load(cls, path: Path) -> "MotionLimits":
        """Read a YAML file whose keys are fields of this class; those left out keep their defaults.

        A file of the bridge's ROS parameters is taken, too; of what it holds besides limits only a name that looks like
        a misspelt limit is refused.

        Raises:
            RobotError: the file cannot be read.
            OptionsError: an unknown name (suggests the nearest), a wrong type, or out of range.
        """
        content = load_mapping(path)
        if len(content) == 1 and isinstance(node := next(iter(content.values())), dict) and ROS_KEY in node:
            if not isinstance(node[ROS_KEY], dict):
                raise RobotError(f"{path}: {ROS_KEY} must hold 'key: value' lines, got {node[ROS_KEY]!r}")
            names = [each.name for each in fields(cls)]
            content = {
                name: value
                for name, value in node[ROS_KEY].items()
                if get_close_matches(str(name), names, n=1, cutoff=ALIKE)
            }
        for name in ("workspace_min_m", "workspace_max_m"):
            if name in content:
                content[name] = tuple(number_array(content[name], f"{path}: {name}", 3).tolist())
        return from_mapping(cls, content)

    def why_not(self, tool: Transform, world_to_base: Transform, *, slack: float = 0.0) -> str | None:
        """Why the tool point must not have a pose (world), or None where it may.

        Args:
            tool: the pose.
            world_to_base: where the robot stands.
            slack: metres and radians that it may be beyond, for poses that were measured.
        """
        point = world_to_base.apply(tool.translation)
        for axis, value, low, high in zip("xyz", point, self.workspace_min_m, self.workspace_max_m, strict=True):
            if not low - slack <= value <= high + slack:
                return f"{axis} = {value:.3f} m is outside the workspace {low:.3f} .. {high:.3f} m (robot base frame)"
        height = float(tool.translation[2])
        if not height >= self.table_clearance_m - slack:
            return f"z = {height:.3f} m above the table is lower than {self.table_clearance_m:.3f} m"
        tilt = tilt_of(tool.rotation)
        if not tilt <= self.max_tilt_rad + slack:
            return f"the tool is tilted by {tilt:.4f} rad from straight down, at most {self.max_tilt_rad} rad may be"
        return None


def check_plan(plan: WaypointPlan, limits: MotionLimits, world_to_base: Transform) -> None:
    """Refuse a plan that must not be executed; nothing has moved when this raises.

    The space above the table inside the box is convex, so the straight line between two waypoints inside it is inside
    it too; the tool may be tilted more between them than at both, and is judged where it is tilted most.

    Raises:
        RobotError: names the first bad waypoint, its value, the limit and what to do.
    """
    reason = why_no_motion(plan, widest=limits.max_gripper_opening_m, shortest=limits.min_interval_s)
    if reason:
        raise RobotError(reason)
    _check_poses(plan, limits, world_to_base)
    _check_motion(plan, limits)


def _check_poses(plan: WaypointPlan, limits: MotionLimits, world_to_base: Transform) -> None:
    rotations = Rotation.from_quat(plan.quaternions)
    turns = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
    tools = [
        (waypoint_name(plan, index), Transform(rotation=rotation, translation=position))
        for index, (rotation, position) in enumerate(zip(rotations.as_matrix(), plan.positions, strict=True))
    ]
    between = [
        (f"between waypoints {index} and {index + 1}", replace(tool, rotation=tipped))
        for index, ((_, tool), turn) in enumerate(zip(tools[:-1], turns, strict=True))
        if (tipped := steepest_between(tool.rotation, turn)) is not None
    ]
    for where, tool in (*tools, *between):
        if reason := limits.why_not(tool, world_to_base):
            raise RobotError(
                f"{where}: {reason}; move the target, recalibrate, or widen the limits if the space is really free"
            )


def _check_motion(plan: WaypointPlan, limits: MotionLimits) -> None:
    steps = np.diff(plan.times)
    if len(steps) == 0:
        return
    velocities = np.diff(plan.positions, axis=0) / steps[:, None]
    lengths = np.linalg.norm(np.diff(plan.positions, axis=0), axis=1)
    if (lengths > limits.max_step_m).any():
        index = int(np.argmax(lengths > limits.max_step_m)) + 1
        raise RobotError(
            f"{waypoint_name(plan, index)}: {lengths[index - 1]:.3f} m from the waypoint before it, at most "
            f"{limits.max_step_m} m are allowed (max_step_m); add waypoints on the way"
        )
    speeds = np.linalg.norm(velocities, axis=1)
    rotations = Rotation.from_quat(plan.quaternions)
    turning = (rotations[:-1].inv() * rotations[1:]).magnitude() / steps
    # Rest before the first and after the last waypoint: the plan must also get going and stop.
    changes = np.diff(velocities, axis=0, prepend=np.zeros((1, 3)), append=np.zeros((1, 3)))
    durations = np.concatenate([steps[:1], (steps[:-1] + steps[1:]) / 2, steps[-1:]])
    accelerations = np.linalg.norm(changes, axis=1) / durations
    for label, unit, values, limit, first, order in (
        ("speed", "m/s", speeds, limits.max_speed_m_s, 1, 1),
        ("angular speed", "rad/s", turning, limits.max_angular_speed_rad_s, 1, 1),
        ("acceleration", "m/s^2", accelerations, limits.max_acceleration_m_s2, 0, 2),
    ):
        fast = values > limit * (1 + RELATIVE_ROUNDING)
        if fast.any():
            index = int(np.argmax(fast))
            raise RobotError(
                f"{waypoint_name(plan, index + first)}: {label} {values[index]:.3f} {unit} exceeds {limit} {unit}; "
                f"stretch the plan's times by a factor of {(values.max() / limit) ** (1 / order):.2f} or more"
            )
