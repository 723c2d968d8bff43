"""ROS messages <-> the core's types. Numbers survive both ways exactly."""

from array import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from egophys_msgs.msg import WaypointPlan as WaypointPlanMessage
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import Path
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from egophys_core.episode import WORLD_FRAME
from egophys_core.recording import POINT_DTYPE, POINT_FIELDS, pack_points
from egophys_core.waypoint_plan import NANOSECONDS, WaypointPlan, plan_of_message


def world_header(stamp: Time | None = None) -> Header:
    """Header in frame `world`; without a stamp the time is zero."""
    return Header(frame_id=WORLD_FRAME, stamp=stamp or Time())


def time_message(nanoseconds: int) -> Time:
    """Time from nanoseconds since the epoch."""
    return Time(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def points_message(
    xyz: np.ndarray, *, ids: np.ndarray, confidence: np.ndarray | None = None, stamp: Time | None = None
) -> PointCloud2:
    """Points as recorded: fields x y z, id, confidence.

    Args:
        xyz: [P, 3] metres, world.
        ids: [P], stable over the episode.
        confidence: [P] 0 to 1; 1 everywhere if not given.
        stamp: header stamp.
    """
    data = pack_points(xyz, ids, np.ones(len(xyz), np.float32) if confidence is None else confidence)
    return PointCloud2(
        header=world_header(stamp),
        height=1,
        width=len(xyz),
        fields=[
            PointField(name=name, offset=offset, datatype=datatype, count=1) for name, offset, datatype in POINT_FIELDS
        ],
        is_bigendian=False,
        point_step=POINT_DTYPE.itemsize,
        row_step=len(data),
        data=array("B", data),
        is_dense=bool(np.isfinite(xyz).all()),
    )


def plan_message(plan: WaypointPlan, stamp: Time | None = None) -> WaypointPlanMessage:
    """A plan as a message. Times become whole nanoseconds, everything else keeps its float64."""
    return WaypointPlanMessage(
        header=world_header(stamp),
        twin_id=plan.twin_id,
        poses=[
            Pose(
                position=Point(**_named("xyz", position)),
                orientation=Quaternion(**_named("xyzw", quaternion)),
            )
            for position, quaternion in zip(plan.positions, plan.quaternions, strict=True)
        ],
        gripper_opening_m=plan.gripper_opening.tolist(),
        time_from_start=[duration_message(time) for time in plan.times],
        predicted_cost=plan.predicted_cost,
    )


def executed_plan(path: Path, planned: WaypointPlanMessage) -> WaypointPlanMessage:
    """The motion that was measured while a plan ran, as a plan to roll out.

    The gripper is open as the plan commanded: between fingers that hold something a measured opening does not
    tell a grasp.

    Args:
        path: measured tool poses, stamped; the path's own stamp is the start of the plan.
        planned: the plan that was executed.
    """
    commanded = plan_of_message(planned)
    start = path.header.stamp.sec * NANOSECONDS + path.header.stamp.nanosec
    stamps = np.array([pose.header.stamp.sec * NANOSECONDS + pose.header.stamp.nanosec for pose in path.poses])
    times = (stamps - start) / NANOSECONDS
    waypoint = np.clip(np.searchsorted(commanded.times, times, side="right") - 1, 0, None)
    return WaypointPlanMessage(
        header=path.header,
        twin_id=planned.twin_id,
        poses=[stamped.pose for stamped in path.poses],
        gripper_opening_m=commanded.gripper_opening[waypoint].tolist(),
        time_from_start=[duration_message(time) for time in times],
        predicted_cost=float("nan"),
    )


def duration_message(seconds: float) -> Duration:
    """The nearest whole nanosecond; seconds may be negative."""
    sec, nanosec = divmod(round(float(seconds) * NANOSECONDS), NANOSECONDS)
    return Duration(sec=sec, nanosec=nanosec)


def _named(names: str, values: np.ndarray) -> dict[str, Any]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}
