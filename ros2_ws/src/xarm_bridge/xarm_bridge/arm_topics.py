"""What the bridge publishes: where the arm is, what it looks like, and what it executed."""

from pathlib import Path
from typing import Any

from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.qos import latched
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs import msg as nav_msgs
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from egophys_core.robot import ArmState, Calibration
from xarm_bridge.messages import base_frame_message, joints_message, pose_message, tool_frame_message

try:
    from tf2_msgs.msg import TFMessage
except ModuleNotFoundError:  # ROS from PyPI has no tf2; `~/world_to_base` and `~/tool_pose` say the same
    TFMessage = None

RELIABLE_DEPTH = 10


class ArmTopics:
    """Publishers of the bridge; the node destroys them at cleanup."""

    def __init__(
        self,
        node: ManagedNode,
        calibration: Calibration,
        *,
        joint_names: tuple[str, ...],
        base_frame: str,
        tool_frame: str,
    ) -> None:
        """Create the publishers, and tell where the robot stands."""
        self._node = node
        self._calibration = calibration
        self._joint_names = joint_names
        self._tool_frame = tool_frame
        # Reliable where viewers ask for it by default (RViz, robot_state_publisher, tf), sensor data else.
        self._tool_poses = self._publisher(PoseStamped, "~/tool_pose", qos_profile_sensor_data)
        self._joints = self._publisher(JointState, "joint_states", QoSProfile(depth=RELIABLE_DEPTH))
        self._openings = self._publisher(Float64, "~/gripper_command", latched())
        self._executed = self._publisher(nav_msgs.Path, "~/executed", latched())
        self._tf = self._publisher(TFMessage, "/tf", QoSProfile(depth=100)) if TFMessage else None
        message = base_frame_message(calibration.world_to_base, base_frame, node.get_clock().now().to_msg())
        self._publisher(TransformStamped, "~/world_to_base", latched()).publish(message)
        if TFMessage is not None:
            self._publisher(TFMessage, "/tf_static", latched()).publish(TFMessage(transforms=[message]))

    def describe_robot(self, urdf: Path) -> None:
        """Publish what the robot looks like, for viewers."""
        self._publisher(String, "robot_description", latched()).publish(String(data=urdf.read_text("utf-8")))

    def publish_state(self, state: ArmState) -> None:
        """Where tool and joints are; stamped with the time of measurement."""
        tool = pose_message(self._calibration.tool_in_world(state.tcp), state.stamp_ns)
        self._tool_poses.publish(tool)
        self._joints.publish(joints_message(state, self._joint_names))
        if self._tf is not None:
            self._tf.publish(TFMessage(transforms=[tool_frame_message(tool, self._tool_frame)]))

    def publish_opening(self, opening: float) -> None:
        """An opening that the gripper was told to have, metres."""
        self._openings.publish(Float64(data=opening))

    def publish_executed(self, path: nav_msgs.Path) -> None:
        """What the tool did while a plan ran."""
        self._executed.publish(path)

    def _publisher(self, kind: Any, name: str, qos: QoSProfile) -> Publisher:
        return self._node.own(self._node.create_publisher(kind, name, qos), self._node.destroy_publisher)
