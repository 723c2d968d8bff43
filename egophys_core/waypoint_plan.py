"""WaypointPlan: where the tool goes, when, and how far the gripper is open."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from egophys_core.episode import LARGEST_SCENE_M, WORLD_FRAME
from egophys_core.errors import PlanningError

NANOSECONDS = 1_000_000_000

UNIT_QUATERNION_TOLERANCE = 1e-3
"""How far a waypoint quaternion's length may be from 1; float32 messages pass, wrong orders do not."""

POINTING_DOWN = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion x y z w of a tool whose z axis points at the table: half a turn about world x."""

OPEN = 0.08
"""Metres between the fingers of an open gripper."""

CLOSED_BELOW = 0.02
"""Metres; a gripper less open than this holds."""

WIDEST_GRIPPER_M = 0.2
"""A gripper that opens wider is none of those known, or is given in millimetres."""

SHORTEST_INTERVAL_S = 0.01
"""Between two waypoints; an arm is not told its pose more often."""

RELATIVE_ROUNDING = 1e-6
"""Slack of a check, so that a plan made exactly at a limit is not refused for rounding."""


@dataclass(frozen=True, kw_only=True)
class WaypointPlan:
    """Timed tool poses in frame `world`; between waypoints the tool moves linearly (slerp for rotation).

    Shapes are checked here, by `why_no_motion` whether the numbers are a motion at all. Whether an arm may execute it
    (inside the workspace, not too fast) is decided by `egophys_core.robot.check_plan`, which names the waypoint.
    """

    times: np.ndarray
    """[W] float64, seconds since the start of the plan."""
    positions: np.ndarray
    """[W, 3] float64, tool position, metres, world."""
    quaternions: np.ndarray
    """[W, 4] float64, tool orientation, x y z w, world."""
    gripper_opening: np.ndarray
    """[W] float64, metres between the fingers; 0 is closed. Holds from its waypoint until the next."""
    twin_id: str
    """The twin it was planned with; empty if none."""
    predicted_cost: float
    """Task cost the planner expects at the end, in the task's unit (metres for a target shape)."""

    def __post_init__(self) -> None:
        if np.ndim(self.times) != 1:
            raise PlanningError(f"plan times must be [W] seconds, one a waypoint, got {np.shape(self.times)}")
        count = len(self.times)
        if count == 0:
            raise PlanningError("a plan needs at least one waypoint, got none")
        for label, array, shape in (
            ("times", self.times, (count,)),
            ("positions", self.positions, (count, 3)),
            ("quaternions", self.quaternions, (count, 4)),
            ("gripper_opening", self.gripper_opening, (count,)),
        ):
            if np.shape(array) != shape:
                raise PlanningError(f"plan {label} must be {shape} for {count} waypoints, got {np.shape(array)}")


def why_no_motion(
    plan: WaypointPlan, *, widest: float = WIDEST_GRIPPER_M, shortest: float = SHORTEST_INTERVAL_S
) -> str | None:
    """Why a plan is no motion that a hand or an arm could do anywhere, naming the waypoint; None if it is one.

    Args:
        plan: of any numbers.
        widest: metres between the fingers, at most.
        shortest: seconds between two waypoints, at least.
    """
    return _why_no_numbers(plan, widest) or _why_no_times(plan, shortest)


def waypoint_name(plan: WaypointPlan, index: int) -> str:
    """A waypoint, for messages."""
    return f"waypoint {index} (t={plan.times[index]:.2f} s)"


def _why_no_numbers(plan: WaypointPlan, widest: float) -> str | None:
    for label, values in (
        ("time", plan.times),
        ("position", plan.positions),
        ("quaternion", plan.quaternions),
        ("gripper opening", plan.gripper_opening),
    ):
        finite = np.isfinite(values).reshape(len(values), -1).all(axis=1)
        if not finite.all():
            index = int(np.argmin(finite))
            return f"waypoint {index}: {label} {np.asarray(values)[index]} is not finite; plan again"
    far = (np.abs(plan.positions) > LARGEST_SCENE_M).any(axis=1)
    if far.any():
        index = int(np.argmax(far))
        return (
            f"{waypoint_name(plan, index)}: position {plan.positions[index].tolist()} m is farther than "
            f"{LARGEST_SCENE_M:g} m from the origin of the world; give metres"
        )
    lengths = np.linalg.norm(plan.quaternions, axis=1)
    wrong = np.abs(lengths - 1) > UNIT_QUATERNION_TOLERANCE
    if wrong.any():
        index = int(np.argmax(wrong))
        return (
            f"{waypoint_name(plan, index)}: quaternion {plan.quaternions[index].tolist()} has length "
            f"{lengths[index]:.4f}, must be 1; normalise it (order x, y, z, w)"
        )
    wrong = (plan.gripper_opening < 0) | (plan.gripper_opening > widest)
    if wrong.any():
        index = int(np.argmax(wrong))
        return (
            f"{waypoint_name(plan, index)}: gripper opening {plan.gripper_opening[index]:.4f} m is outside "
            f"0 .. {widest} m; is it in metres?"
        )
    return None


def _why_no_times(plan: WaypointPlan, shortest: float) -> str | None:
    if plan.times[0] < 0:
        return f"waypoint 0: time {plan.times[0]:.3f} s is before the start of the plan; start at 0"
    steps = np.diff(plan.times)
    short = steps < shortest * (1 - RELATIVE_ROUNDING)
    if short.any():
        index = int(np.argmax(short)) + 1
        return (
            f"{waypoint_name(plan, index)}: {steps[index - 1]:.4f} s after the waypoint before it, must be at least "
            f"{shortest} s later; merge them or stretch the plan"
        )
    return None


def plan_of_message(message: Any) -> WaypointPlan:
    """The plan in an egophys_msgs/WaypointPlan, a message object of rclpy or of rosbags.

    A time of whole nanoseconds is the float64 nearest to it, so a plan that has been a message once does not
    change when it becomes one again.

    Raises:
        PlanningError: the frame is not `world`, no waypoint, or lists of different lengths.
    """
    if message.header.frame_id != WORLD_FRAME:
        raise PlanningError(
            f"the plan is in frame {message.header.frame_id!r}, needed is {WORLD_FRAME!r}; transform it first"
        )
    positions = [(pose.position.x, pose.position.y, pose.position.z) for pose in message.poses]
    quaternions = [
        (pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w) for pose in message.poses
    ]
    nanoseconds = [each.sec * NANOSECONDS + each.nanosec for each in message.time_from_start]
    return WaypointPlan(
        times=np.array(nanoseconds, np.float64) / NANOSECONDS,
        positions=np.array(positions, np.float64),
        quaternions=np.array(quaternions, np.float64),
        gripper_opening=np.array(message.gripper_opening_m, np.float64),
        twin_id=message.twin_id,
        predicted_cost=message.predicted_cost,
    )
