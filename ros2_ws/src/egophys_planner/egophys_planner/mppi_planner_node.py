"""mppi_planner_node: plans gripper motions to a target shape with the twin node's rollouts."""

import sys
from functools import partial

from egophys_msgs.action import PlanToTarget
from egophys_msgs.srv import RolloutTwin
from egophys_ros_common.conversions import plan_message
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_number, declare_options, declare_texts, read_options
from egophys_ros_common.qos import latched
from egophys_ros_common.running import run_node
from egophys_ros_common.worker import CanceledError, Worker
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.client import Client
from std_msgs.msg import UInt8MultiArray

from egophys_core.errors import EgophysError, PlanningError
from egophys_core.planning import PlanOptions
from egophys_core.recording import xyz_of_message
from egophys_core.twin import Twin, decode_twin
from egophys_core.waypoint_plan import WaypointPlan
from egophys_planner.planner_topics import PlannerTopics
from egophys_planner.planning_job import PlanningJob
from egophys_planner.rollout_client import RolloutClient

NAME_PARAMETERS = {
    "rollout_service": ("/twin_node/rollout", "RolloutTwin service of the twin node"),
    "model_topic": ("/twin_node/model", "topic on which the twin node hands out the twin in use"),
}
TIMEOUT_PARAMETERS = {
    "service_timeout_s": (5.0, "how long to wait for the rollout service to be there, s"),
    "rollout_timeout_s": (60.0, "how long to wait for the rollouts of one iteration, s"),
}


class MppiPlannerNode(ManagedNode):
    """Serves `plan_to_target`, one goal at a time, with the twin that the twin node has in use."""

    def __init__(self) -> None:
        """Declare the parameters: those of the node and every option of the planner."""
        super().__init__("mppi_planner_node")
        declare_texts(self, NAME_PARAMETERS)
        for name, (seconds, description) in TIMEOUT_PARAMETERS.items():
            declare_number(self, name, seconds, low=0.1, high=3600.0, doc=description, at_once=True)
        declare_options(self, PlanOptions, at_once=True)
        self._twin: Twin | None = None
        self._job: PlanningJob | None = None
        self._worker: Worker
        self._topics: PlannerTopics
        self._rollouts: Client

    def configure(self) -> None:
        """Create topics, the client and the action, and listen for the twin."""
        read_options(self, PlanOptions)
        self._twin = None
        self._worker = self.own(Worker("plan", self.hand_over), Worker.close)
        self._topics = PlannerTopics(self)
        self._rollouts = self.own(
            self.create_client(RolloutTwin, self.get_parameter("rollout_service").value), self.destroy_client
        )
        model_topic = self.get_parameter("model_topic").value
        self.own(
            self.create_subscription(UInt8MultiArray, model_topic, self._take_twin, latched()),
            self.destroy_subscription,
        )
        server = ActionServer(
            self,
            PlanToTarget,
            "~/plan_to_target",
            self._plan,
            goal_callback=self._check_goal,
            handle_accepted_callback=self._accept_goal,
            cancel_callback=self._cancel_goal,
        )
        self.own(server, ActionServer.destroy)

    def deactivate(self) -> None:
        """Cancel the goal and wait until it has stopped."""
        if self._job is not None:
            self._job.canceled.set()
        self._worker.stop()

    def health(self) -> dict[str, str]:
        """Which twin the next plan is made with, and whether one is being made."""
        return {"twin id": self._twin.twin_id if self._twin else "", "planning": str(self._job is not None)}

    def _take_twin(self, message: UInt8MultiArray) -> None:
        try:
            self._twin = decode_twin(bytes(message.data), name=self.get_parameter("model_topic").value)
        except EgophysError as error:
            self.refuse("cannot use the twin received", error)

    def _check_goal(self, goal: PlanToTarget.Goal) -> GoalResponse:
        try:
            if not self.is_active:
                raise PlanningError("the node is not active; configure and activate it first")
            if self._job is not None:
                raise PlanningError("another goal is being planned; wait for it, or cancel it, and ask again")
            self._job_of(goal)
            if len(xyz_of_message(goal.target, source="target")) == 0:
                raise PlanningError("the target has no points")
        except EgophysError as error:
            # An action rejects without words; they are in the log and in /diagnostics.
            self.refuse("goal rejected", error)
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _accept_goal(self, handle: ServerGoalHandle) -> None:
        self._job = self._job_of(handle.request)
        handle.execute(partial(self._plan, self._job))

    def _cancel_goal(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._job is None:
            return CancelResponse.REJECT
        self._job.canceled.set()
        return CancelResponse.ACCEPT

    async def _plan(self, job: PlanningJob, handle: ServerGoalHandle) -> PlanToTarget.Result:
        target = handle.request.target
        self._topics.publish_problem(job, target)
        forward = RolloutClient(
            self._rollouts,
            twin_id=job.twin.twin_id,
            target=target,
            service_timeout_s=self.get_parameter("service_timeout_s").value,
            answer_timeout_s=self.get_parameter("rollout_timeout_s").value,
            canceled=job.canceled,
        )

        def feed_back(done: int, total: int, cost: float) -> None:
            feedback = PlanToTarget.Feedback(iteration=done, iterations=total, best_cost=cost)
            self.hand_over(handle.publish_feedback, feedback)

        try:
            plan, initial_cost = await self._worker.run(partial(job.run, forward, feed_back))
        except Exception as error:
            return self._fail(handle, error)
        finally:
            self._job = None
        return self._succeed(handle, plan, initial_cost)

    def _succeed(self, handle: ServerGoalHandle, plan: WaypointPlan, initial_cost: float) -> PlanToTarget.Result:
        self.last_error = ""
        message = plan_message(plan, self.get_clock().now().to_msg())
        self._topics.publish_plan(message)
        handle.succeed()
        return PlanToTarget.Result(
            success=True,
            message=f"cost {initial_cost:.4f} m without moving, {plan.predicted_cost:.4f} m predicted",
            plan=message,
            initial_cost=initial_cost,
        )

    def _fail(self, handle: ServerGoalHandle, error: Exception) -> PlanToTarget.Result:
        if handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        if isinstance(error, CanceledError):
            return PlanToTarget.Result(message=f"canceled: {error}")
        return PlanToTarget.Result(message=self.refuse("planning failed", error))

    def _job_of(self, goal: PlanToTarget.Goal) -> PlanningJob:
        options = read_options(self, PlanOptions, goal.options_json)
        if self._twin is None:
            raise PlanningError(
                f"no twin received on {self.get_parameter('model_topic').value}; is the twin node active, with a twin?"
            )
        if goal.twin_id not in ("", self._twin.twin_id):
            raise PlanningError(f"twin {goal.twin_id} is not in use, {self._twin.twin_id} is; ask for that one")
        return PlanningJob(twin=self._twin, options=options, seed=goal.seed)


def main() -> int:
    """Run the node; the exit code."""
    return run_node(MppiPlannerNode)


if __name__ == "__main__":
    sys.exit(main())
