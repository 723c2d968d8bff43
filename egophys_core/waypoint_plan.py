"""WaypointPlan: where the tool goes, when, and how far the gripper is open."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from egophys_core.episode import WORLD_FRAME
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


@dataclass(frozen=True, kw_only=True)
class WaypointPlan:
    """Timed tool poses in frame `world`; between waypoints the tool moves linearly (slerp for rotation).

    Shapes are checked here. Whether the numbers may be executed (finite, inside the workspace, not too
    fast) is decided by `egophys_core.robot.check_plan`, which names the waypoint.
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
