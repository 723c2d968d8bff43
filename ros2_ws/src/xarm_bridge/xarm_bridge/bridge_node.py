"""bridge_node: executes waypoint plans on an arm, one at a time, and publishes where the arm is."""

import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from egophys_msgs.action import ExecutePlan
from egophys_msgs.msg import TwinInfo
from egophys_ros_common.goal_server import GoalServer
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_number, declare_options, declare_texts, read_options
from egophys_ros_common.qos import latched
from egophys_ros_common.running import run_node
from egophys_ros_common.worker import Worker
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from egophys_core.errors import ArmFaultError, ArmLostError, RobotError
from egophys_core.plan_file import read_plan
from egophys_core.robot import (
    ArmDriver,
    ArmIdentity,
    ArmLink,
    ArmState,
    Calibration,
    LinkEvents,
    MotionLimits,
    Origin,
    Ownership,
    PlanExecutor,
    Transform,
    check_origin,
    check_plan,
    load_driver,
)
from egophys_core.waypoint_plan import NANOSECONDS, WaypointPlan, plan_of_message
from xarm_bridge.arm_topics import ArmTopics
from xarm_bridge.messages import pose_message, result_message

FEEDBACK_EVERY = 5
"""Measured poses per feedback message: 10 Hz."""
LOST, ERROR, PLAN = "lost", "error", "plan"
"""What is told once until it is over, whoever notices it first: no answer, an error of the arm, a plan that failed."""

PARAMETERS = {
    "driver": (
        "xarm_bridge.xarm6:XArm6",
        "module:Class of the arm's driver, a subclass of egophys_core.robot.ArmDriver",
    ),
    "robot_ip": ("", "IPv4 address of the arm's control box, or of the emulator"),
    "allow_emulator": (False, "whether an emulated control box may stand for the arm"),
    "calibration_file": ("", "YAML file with world_to_base and tool, as egophys calibrate writes it"),
    "base_frame": ("link_base", "tf name of the robot's base frame; xarm_ros2 calls it link_base"),
    "tool_frame": ("tool", "tf name of the tool point's frame"),
    "description_file": ("", "URDF to publish on robot_description; empty for that of the xArm6"),
    "has_gripper": (True, "whether a gripper is mounted; without one plans' openings are ignored"),
    "twin_info_topic": ("twin_node/info", "topic that says which twin is in use; a plan of another one is refused"),
}


class BridgeNode(ManagedNode):
    """Owns the arm when configured, executes plans when active; `~/stop` works in every state."""

    def __init__(self) -> None:
        """Declare the parameters, and offer the stop."""
        super().__init__("bridge_node")
        declare_texts(self, PARAMETERS)
        doc = "how long to wait at configuration for a control box that is still starting, s"
        declare_number(self, "connect_patience_s", 10.0, low=0.0, high=60.0, doc=doc)
        doc = "how old a plan may be that is executed, s; 0 for any age"
        declare_number(self, "max_plan_age_s", 300.0, low=0.0, high=1e6, doc=doc, at_once=True)
        declare_options(self, MotionLimits)
        self._limits: MotionLimits
        self._calibration: Calibration
        self._driver: ArmDriver
        self._identity: ArmIdentity
        self._ownership: Ownership
        self._topics: ArmTopics
        self._executor: PlanExecutor
        self._link: ArmLink
        self._recoveries: Worker
        self._executions: Worker
        self._goal: ServerGoalHandle | None = None
        self._twin_id = ""
        self._told: set[str] = set()
        self._over: set[str] = set()
        self._stop_requested = threading.Event()
        self._stops = Worker("stop", self.hand_over)
        self._halt = self._halt_unowned
        self.create_service(Trigger, "~/stop", self._stop_arm, callback_group=ReentrantCallbackGroup())

    def configure(self) -> None:
        """Connect to the arm and own it (nothing moves), tell where it stands, and offer the action."""
        self._limits = read_options(self, MotionLimits)
        self._calibration = Calibration.load(self._calibration_path())
        self._connect()
        self._recoveries = self.own(Worker("recover", self.hand_over), Worker.close)
        self._executions = self.own(Worker("execute", self.hand_over), Worker.close)
        self._topics = ArmTopics(
            self,
            self._calibration,
            joint_names=self._driver.joint_names,
            base_frame=self.get_parameter("base_frame").value,
            tool_frame=self.get_parameter("tool_frame").value,
        )
        self._topics.describe_robot(self._description_path())
        self._watch()
        topic = self.get_parameter("twin_info_topic").value
        self.own(self.create_subscription(TwinInfo, topic, self._take_twin, latched()), self.destroy_subscription)
        GoalServer(
            self,
            ExecutePlan,
            "~/execute",
            noun="plan",
            begin=self._begin,
            run=self._execute,
            cancel=self._cancel,
        )
        service = self.create_service(
            Trigger, "~/clear_error", self._clear_error, callback_group=ReentrantCallbackGroup()
        )
        self.own(service, self.destroy_service)

    def deactivate(self) -> None:
        """Stop the plan that runs and wait until the arm stands."""
        self._stop_requested.set()
        self._executions.stop()

    def fault(self) -> str:
        """Why no plan can be executed now."""
        if self._link.lost:
            return f"controller lost: {self._link.lost}; looking for it"
        return self._driver.describe_error(self._link.error_code) if self._link.error_code else ""

    def health(self) -> dict[str, str]:
        """Which arm this is, what it does and how evenly the newest plan was streamed."""
        kind = "emulator " if self._identity.is_emulator else ""
        return {
            "robot": f"{kind}{self._identity.serial} at {self._identity.address}",
            "executing": str(self._goal is not None),
            "controller error": str(self._link.error_code),
            "twin id": self._twin_id,
            "longest gap in the stream (ms)": f"{1e3 * self._executor.longest_gap:.1f}",
        }

    def _connect(self) -> None:
        driver = load_driver(self.get_parameter("driver").value, self.get_parameter("robot_ip").value)
        self.own(driver, ArmDriver.close)
        self._identity = driver.connect(patience=self.get_parameter("connect_patience_s").value)
        if self._identity.is_emulator and not self.get_parameter("allow_emulator").value:
            raise RobotError(
                f"what answers at {self._identity.address} is an emulator (serial {self._identity.serial}), not the "
                "arm; set allow_emulator to true to use it"
            )
        self._ownership = Ownership(driver, self._identity.serial, self.get_fully_qualified_name())
        self.own(self._ownership, Ownership.release)
        self._ownership.acquire()
        if not self._ownership.is_seen_elsewhere:
            self.get_logger().warning("this control box keeps no notes: bridges on other machines will not be noticed")
        if self._ownership.abandoned_by:
            self.get_logger().warning(f"{self._ownership.abandoned_by} left the arm without releasing it; it is halted")
            driver.halt()
        self._driver = driver

    def _watch(self) -> None:
        self._executor = PlanExecutor(
            self._driver,
            calibration=self._calibration,
            limits=self._limits,
            has_gripper=self.get_parameter("has_gripper").value,
            on_gripper=partial(self.hand_over, self._publish_opening),
            require_permit=self._ownership.require,
        )
        self._halt = self.own(self._executor.stop, self._forget_executor)
        events = LinkEvents(
            on_state=partial(self.hand_over, self._publish_state),
            on_error=partial(self.hand_over, self._take_error),
            on_lost=partial(self.hand_over, self._lose),
            on_found=partial(self.hand_over, self._find),
        )
        self._link = self.own(ArmLink(self._driver, self._executor.measured, self._ownership, events), ArmLink.close)

    def _forget_executor(self, stop: Callable[[], None]) -> None:
        self._halt = self._halt_unowned

    def _calibration_path(self) -> Path:
        path = self.get_parameter("calibration_file").value
        if not path:
            raise RobotError("parameter calibration_file is empty; give the YAML file with world_to_base")
        return Path(path)

    def _description_path(self) -> Path:
        default = Path(get_package_share_directory("xarm_bridge"), "urdf", "xarm6.urdf")
        path = Path(self.get_parameter("description_file").value or default)
        if not path.is_file():
            raise RobotError(f"parameter description_file: there is no file {path}")
        return path

    def _publish_state(self, state: ArmState) -> None:
        if self.is_active:
            self._topics.publish_state(state)

    def _publish_opening(self, opening: float) -> None:
        if self.is_active:
            self._topics.publish_opening(opening)

    def _take_twin(self, message: TwinInfo) -> None:
        self._twin_id = message.twin_id

    def _take_error(self, code: int) -> None:
        if code:
            self._tell(ERROR, "the arm stopped", ArmFaultError(self._driver.describe_error(code)))
        else:
            self._end(ERROR)

    def _lose(self, error: RobotError) -> None:
        self._stop_requested.set()
        self._tell(LOST, "controller lost", error)

    def _find(self) -> None:
        self._end(LOST)
        self.last_error = ""
        self.get_logger().info(f"controller at {self._identity.address} found again; the arm was halted")

    def _tell(self, key: str, what: str, error: Exception) -> str:
        """Refuse, in the log only once until it is over; what to answer."""
        if key in self._told:
            return str(error)
        self._told.add(key)
        return self.refuse(what, error)

    def _end(self, key: str) -> None:
        """What was told is over; a plan under way may still fail of it, and is not told as another thing."""
        self._over.add(key)
        if self._goal is None:
            self._told -= self._over
            self._over.clear()

    def _begin(self, handle: ServerGoalHandle) -> WaypointPlan:
        if not self.is_active:
            raise RobotError("the bridge is not active; activate it first")
        if self._link.lost:
            raise ArmLostError(f"{self.fault()}; send the plan again once it is found")
        if self._goal is not None:
            raise RobotError("another plan is being executed; cancel it or wait for its end")
        plan, stamp_ns = _plan_asked(handle.request)
        origin = Origin(twin_id=self._twin_id, max_age=self.get_parameter("max_plan_age_s").value)
        check_origin(plan, stamp_ns, self.get_clock().now().nanoseconds, origin)
        check_plan(plan, self._limits, self._calibration.world_to_base)
        self._goal = handle
        self._stop_requested = threading.Event()
        return plan

    def _cancel(self) -> bool:
        self._stop_requested.set()
        return self._goal is not None

    async def _execute(self, plan: WaypointPlan, handle: ServerGoalHandle) -> ExecutePlan.Result:
        count = 0

        def on_progress(share: float, pose: Transform) -> None:
            nonlocal count
            if count % FEEDBACK_EVERY == 0:
                self.hand_over(self._feed_back, handle, share, pose)
            count += 1

        run = partial(self._executor.execute, plan, stop=self._stop_requested, on_progress=on_progress)
        try:
            executed = await self._executions.run(run)
        except Exception as error:
            handle.abort()
            return ExecutePlan.Result(success=False, message=self._fail(error))
        finally:
            self._goal = None
            self._told -= self._over
            self._over.clear()
        result = result_message(executed)
        self._topics.publish_executed(result.executed)
        if executed.completed:
            self.last_error = ""
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
            if self._link.lost:
                result.message += f": {self._link.lost}"
        return result

    def _fail(self, error: Exception) -> str:
        key = LOST if isinstance(error, ArmLostError) else ERROR if isinstance(error, ArmFaultError) else PLAN
        message = self._tell(LOST if LOST in self._told else key, "plan not executed", error)
        self._told.discard(PLAN)
        if isinstance(error, ArmLostError) and LOST not in self._over:  # else it was connected anew meanwhile
            self._link.lose(error)
        return message

    def _feed_back(self, handle: ServerGoalHandle, share: float, pose: Transform) -> None:
        if self._goal is not None and handle is self._goal:
            current = pose_message(pose, self.get_clock().now().nanoseconds)
            handle.publish_feedback(ExecutePlan.Feedback(progress=share, current=current))

    async def _stop_arm(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._stop_requested.set()
        self.get_logger().warning("stopped on request")
        return await self._answer(response, self._stops.run(self._halt), "stopped")

    def _halt_unowned(self) -> None:
        # Nothing of ours moves; whatever else moves the arm shall be stopped all the same.
        driver = load_driver(self.get_parameter("driver").value, self.get_parameter("robot_ip").value)
        try:
            driver.connect()
            driver.halt()
        finally:
            driver.close()

    async def _clear_error(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return await self._answer(response, self._recoveries.run(self._driver.clear_error), "error cleared")

    async def _answer(self, response: Trigger.Response, work: Future, done: str) -> Trigger.Response:
        try:
            await work
        except Exception as error:
            response.message = self.refuse(f"not {done}", error)
            return response
        self.last_error = ""
        response.success, response.message = True, done
        return response


def _plan_asked(goal: ExecutePlan.Goal) -> tuple[WaypointPlan, int]:
    """The plan of a goal, and when it was made, nanoseconds since the epoch."""
    if goal.plan_file:
        file = read_plan(Path(goal.plan_file))
        return file.plan, file.stamp_ns
    stamp = goal.plan.header.stamp
    return plan_of_message(goal.plan), stamp.sec * NANOSECONDS + stamp.nanosec


def main() -> int:
    """Run the node; the exit code."""
    return run_node(BridgeNode)


if __name__ == "__main__":
    sys.exit(main())
