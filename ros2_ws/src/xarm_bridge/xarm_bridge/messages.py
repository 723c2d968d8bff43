"""Poses and executed motions as ROS messages, and what a message says about a plan."""

from builtin_interfaces.msg import Time
from egophys_msgs.action import ExecutePlan
from egophys_ros_common.conversions import time_message, world_header
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, TransformStamped, Vector3
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from egophys_core.robot import ArmState, ExecutedMotion, Transform
from egophys_core.waypoint_plan import NANOSECONDS


def pose_message(pose: Transform, stamp_ns: int) -> PoseStamped:
    """A pose in the world at a time in nanoseconds since the epoch."""
    x, y, z = pose.translation.tolist()
    return PoseStamped(
        header=world_header(time_message(stamp_ns)),
        pose=Pose(position=Point(x=x, y=y, z=z), orientation=_quaternion(pose)),
    )


def base_frame_message(world_to_base: Transform, base_frame: str, stamp: Time) -> TransformStamped:
    """Where the robot's base stands in the world.

    tf names the parent frame first and gives the child's pose in it, which is the inverse of the transform
    that takes world coordinates to base coordinates.
    """
    base_in_world = world_to_base.inverse()
    message = TransformStamped(header=world_header(stamp), child_frame_id=base_frame)
    x, y, z = base_in_world.translation.tolist()
    message.transform.translation = Vector3(x=x, y=y, z=z)
    message.transform.rotation = _quaternion(base_in_world)
    return message


def joints_message(state: ArmState, names: tuple[str, ...]) -> JointState:
    """Measured joint angles."""
    return JointState(
        header=Header(stamp=time_message(state.stamp_ns)), name=list(names), position=state.joints.tolist()
    )


def tool_frame_message(tool: PoseStamped, tool_frame: str) -> TransformStamped:
    """The tool point as a frame below the world."""
    message = TransformStamped(header=tool.header, child_frame_id=tool_frame)
    place = tool.pose.position
    message.transform.translation = Vector3(x=place.x, y=place.y, z=place.z)
    message.transform.rotation = tool.pose.orientation
    return message


def result_message(executed: ExecutedMotion) -> ExecutePlan.Result:
    """The measured motion; each pose carries the time it was measured at."""
    poses = []
    for index, time in enumerate(executed.times):
        stamp_ns = executed.start_ns + round(float(time) * NANOSECONDS)
        pose = Transform.from_quaternion(executed.positions[index], executed.quaternions[index])
        poses.append(pose_message(pose, stamp_ns))
    return ExecutePlan.Result(
        success=executed.completed,
        message="executed" if executed.completed else "stopped before the end of the plan",
        executed=Path(header=world_header(time_message(executed.start_ns)), poses=poses),
        gripper_opening_m=executed.gripper_opening.tolist(),
    )


def _quaternion(pose: Transform) -> Quaternion:
    x, y, z, w = pose.quaternion.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
