"""bridge_node: executes waypoint plans on an xArm, one at a time, and publishes where the tool is."""

import sys
import threading
from functools import partial
from pathlib import Path
from typing import Any

from egophys_msgs.action import ExecutePlan
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_number, declare_options, declare_texts, read_options
from egophys_ros_common.qos import latched
from egophys_ros_common.running import run_node
from egophys_ros_common.worker import Worker
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs import msg as nav_msgs
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.task import Future
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from egophys_core.errors import EgophysError, RobotError
from egophys_core.robot import Calibration, MotionLimits, Transform, check_plan
from egophys_core.waypoint_plan import plan_of_message
from xarm_bridge.arm import Arm
from xarm_bridge.connection import Connection
from xarm_bridge.messages import base_frame_message, pose_message, result_message
from xarm_bridge.monitor import Monitor

try:
    from tf2_msgs.msg import TFMessage
except ModuleNotFoundError:  # ROS from PyPI has no tf2; `~/world_to_base` says the same
    TFMessage = None

FEEDBACK_EVERY = 5
"""Measured poses per feedback message: 10 Hz."""

PARAMETERS = {
    "robot_ip": ("", "IPv4 address of the xArm's control box, or of the emulator"),
    "calibration_file": ("", "YAML file with world_to_base and tool, see config/world_to_base.yaml"),
    "base_frame": ("link_base", "tf name of the robot's base frame; xarm_ros2 calls it link_base"),
    "has_gripper": (True, "whether an xArm gripper is mounted; without one plans' openings are ignored"),
}


class BridgeNode(ManagedNode):
    """Connects to the arm when configured, executes plans when active; `~/stop` works in both states."""

    def __init__(self) -> None:
        """Declare the parameters: those of the node and every motion limit."""
        super().__init__("bridge_node")
        declare_texts(self, PARAMETERS)
        doc = "how long to wait at configuration for a control box that is still starting"
        declare_number(self, "connect_patience_s", 10.0, low=0.0, high=60.0, doc=doc)
        declare_options(self, MotionLimits)
        self._calibration: Calibration
        self._limits: MotionLimits
        self._arm: Arm
        self._stops: Worker
        self._recoveries: Worker
        self._executions: Worker
        self._monitor: Monitor | None = None
        self._goal: ServerGoalHandle | None = None
        self._stop_requested = threading.Event()

    def configure(self) -> None:
        """Connect to the arm (nothing moves), tell where it stands, and offer the action and the services."""
        self._limits = read_options(self, MotionLimits)
        self._calibration = Calibration.load(self._calibration_path())
        connection = Connection(
            self.get_parameter("robot_ip").value, patience=self.get_parameter("connect_patience_s").value
        )
        self.own(connection, Connection.close)
        self._arm = Arm(
            connection,
            calibration=self._calibration,
            limits=self._limits,
            has_gripper=self.get_parameter("has_gripper").value,
            on_gripper=partial(self.hand_over, self._publish_opening),
        )
        self._stops = self.own(Worker("stop", self.hand_over), Worker.close)
        self._recoveries = self.own(Worker("recover", self.hand_over), Worker.close)
        self._executions = self.own(Worker("execute", self.hand_over), Worker.close)
        self._tool_poses = self._publisher(PoseStamped, "~/tool_pose", qos_profile_sensor_data)
        self._openings = self._publisher(Float64, "~/gripper_command", latched())
        self._executed = self._publisher(nav_msgs.Path, "~/executed", latched())
        self._publish_base_frame()
        self.own(
            ActionServer(
                self,
                ExecutePlan,
                "~/execute",
                self._execute,
                goal_callback=self._check_goal,
                handle_accepted_callback=self._accept_goal,
                cancel_callback=self._cancel_goal,
            ),
            ActionServer.destroy,
        )
        waiting = ReentrantCallbackGroup()
        for name, callback in (("~/stop", self._stop_arm), ("~/clear_error", self._clear_error)):
            self.own(self.create_service(Trigger, name, callback, callback_group=waiting), self.destroy_service)

    def activate(self) -> None:
        """Take plans and publish the tool pose."""
        self._monitor = Monitor(
            self._arm,
            on_pose=self._tell_pose,
            on_failure=partial(self.hand_over, self.refuse, "cannot read the arm"),
        )

    def deactivate(self) -> None:
        """Stop the plan that runs and wait until the arm stands."""
        self._stop_requested.set()
        self._executions.stop()
        if self._monitor is not None:
            self._monitor.close()
            self._monitor = None

    def health(self) -> dict[str, str]:
        """The address, what the arm does and the controller's error code."""
        return {
            "robot": self.get_parameter("robot_ip").value,
            "executing": str(self._goal is not None),
            "controller error": str(self._monitor.error_code) if self._monitor else "unknown",
        }

    def _calibration_path(self) -> Path:
        path = self.get_parameter("calibration_file").value
        if not path:
            raise RobotError("parameter calibration_file is empty; give the YAML file with world_to_base")
        return Path(path)

    def _publisher(self, kind: Any, name: str, qos: QoSProfile) -> Publisher:
        return self.own(self.create_publisher(kind, name, qos), self.destroy_publisher)

    def _publish_base_frame(self) -> None:
        now = self.get_clock().now().to_msg()
        base_frame = self.get_parameter("base_frame").value
        message = base_frame_message(self._calibration.world_to_base, base_frame, now)
        self._publisher(TransformStamped, "~/world_to_base", latched()).publish(message)
        if TFMessage is not None:
            self._publisher(TFMessage, "/tf_static", latched()).publish(TFMessage(transforms=[message]))

    def _tell_pose(self, pose: Transform) -> None:
        # On the monitor's thread: the stamp is that of the measurement, however busy the executor is.
        self.hand_over(self._publish_pose, pose_message(pose, self.get_clock().now().to_msg()))

    def _publish_pose(self, message: PoseStamped) -> None:
        if self.is_active:
            self._tool_poses.publish(message)

    def _publish_opening(self, opening: float) -> None:
        if self.is_active:
            self._openings.publish(Float64(data=opening))

    def _check_goal(self, goal: ExecutePlan.Goal) -> GoalResponse:
        try:
            if not self.is_active:
                raise RobotError("the bridge is not active; activate it first")
            if self._goal is not None:
                raise RobotError("another plan is being executed; cancel it or wait for its end")
            check_plan(plan_of_message(goal.plan), self._limits, self._calibration.world_to_base)
        except EgophysError as error:
            # An action rejects without words: they are in the log and in /diagnostics.
            self.refuse("plan rejected", error)
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _accept_goal(self, handle: ServerGoalHandle) -> None:
        self._goal = handle
        self._stop_requested = threading.Event()
        handle.execute()

    def _cancel_goal(self, handle: ServerGoalHandle) -> CancelResponse:
        self._stop_requested.set()
        return CancelResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> ExecutePlan.Result:
        count = 0

        def on_progress(share: float, pose: Transform) -> None:
            nonlocal count
            if count % FEEDBACK_EVERY == 0:
                self.hand_over(self._feed_back, handle, share, pose)
            count += 1

        plan = plan_of_message(handle.request.plan)
        run = partial(self._arm.execute, plan, stop=self._stop_requested, on_progress=on_progress)
        try:
            executed = await self._executions.run(run)
        except Exception as error:
            handle.abort()
            return ExecutePlan.Result(success=False, message=self.refuse("plan not executed", error))
        finally:
            self._goal = None
        result = result_message(executed)
        self._executed.publish(result.executed)
        if executed.completed:
            self.last_error = ""
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    def _feed_back(self, handle: ServerGoalHandle, share: float, pose: Transform) -> None:
        if self._goal is not None and handle is self._goal:
            current = pose_message(pose, self.get_clock().now().to_msg())
            handle.publish_feedback(ExecutePlan.Feedback(progress=share, current=current))

    async def _stop_arm(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._stop_requested.set()
        return await self._answer(response, self._stops.run(self._arm.stop), "stopped")

    async def _clear_error(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return await self._answer(response, self._recoveries.run(self._arm.clear_error), "error cleared")

    async def _answer(self, response: Trigger.Response, work: Future, done: str) -> Trigger.Response:
        try:
            await work
        except Exception as error:
            response.message = self.refuse(f"not {done}", error)
            return response
        response.success, response.message = True, done
        return response


def main() -> int:
    """Run the node; the exit code."""
    return run_node(BridgeNode)


if __name__ == "__main__":
    sys.exit(main())
