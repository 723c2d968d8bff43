"""mppi_planner_node: plans gripper motions to a target shape with the twin node's rollouts."""

import sys

from egophys_msgs.action import PlanToTarget
from egophys_ros_common.goal_server import GoalServer
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_number, declare_options, declare_texts, read_options
from egophys_ros_common.running import run_node
from egophys_ros_common.worker import CanceledError
from rclpy.action.server import ServerGoalHandle

from egophys_core.errors import PlanningError
from egophys_core.planning import PlanOptions
from egophys_planner.plan_and_execute import PlanAndExecuteServer
from egophys_planner.planning import Planned, Planning
from egophys_planner.planning_job import PlanningJob

NAME_PARAMETERS = {
    "rollout_service": ("twin_node/rollout", "RolloutTwin service of the twin node"),
    "model_topic": ("twin_node/model", "topic on which the twin node hands out the twin in use"),
    "object_topic": ("object/points", "topic of the object's tracked points, from which plans begin"),
    "execute_action": ("bridge_node/execute", "ExecutePlan action of the bridge, for plan_and_execute"),
}
TIMEOUT_PARAMETERS = {
    "service_timeout_s": (5.0, "how long to wait for the rollout service to be there, s"),
    "rollout_timeout_s": (60.0, "how long to wait for the rollouts of one iteration, s"),
    "object_max_age_s": (3.0, "age up to which an observation shows where the object is now, s"),
}


class MppiPlannerNode(ManagedNode):
    """Serves `plan_to_target` and `plan_and_execute`, one at a time, with the twin that the twin node has in use."""

    def __init__(self) -> None:
        """Declare the parameters: those of the node and every option of the planner."""
        super().__init__("mppi_planner_node")
        declare_texts(self, NAME_PARAMETERS)
        for name, (seconds, description) in TIMEOUT_PARAMETERS.items():
            declare_number(self, name, seconds, low=0.1, high=3600.0, doc=description, at_once=True)
        declare_options(self, PlanOptions, at_once=True)
        self._planning: Planning
        self._executing: PlanAndExecuteServer

    def configure(self) -> None:
        """Create topics, clients, the services and the action, and listen for the twin and the object."""
        read_options(self, PlanOptions)
        self._planning = Planning(self)
        self._executing = PlanAndExecuteServer(self, self._planning)
        GoalServer(
            self,
            PlanToTarget,
            "~/plan_to_target",
            noun="goal",
            begin=self._begin,
            run=self._run,
            cancel=self._planning.cancel,
        )

    def deactivate(self) -> None:
        """Cancel what is planned or executed, and wait until the planning has stopped."""
        self._executing.stop()
        self._planning.stop()

    def health(self) -> dict[str, str]:
        """Which twin the next plan is made with, whether one is being made, and whether the object is seen."""
        return {
            "twin id": self._planning.twin_id,
            "planning": str(self._planning.is_busy),
            "object": self._planning.object_state,
        }

    def _begin(self, handle: ServerGoalHandle) -> PlanningJob:
        return self._planning.begin(handle.request)

    async def _run(self, job: PlanningJob, handle: ServerGoalHandle) -> PlanToTarget.Result:
        def feed_back(done: int, total: int, cost: float) -> None:
            feedback = PlanToTarget.Feedback(iteration=done, iterations=total, best_cost=cost)
            self.hand_over(handle.publish_feedback, feedback)

        try:
            planned: Planned = await self._planning.run(job, feed_back)
        except Exception as error:
            if handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            if isinstance(error, CanceledError):
                return PlanToTarget.Result(message=f"canceled: {error}")
            return PlanToTarget.Result(message=self.refuse("planning failed", error))
        if planned.reached:
            handle.succeed()
        else:
            self.refuse("planning failed", PlanningError(planned.message))
            handle.abort()
        return PlanToTarget.Result(
            success=planned.reached,
            reached=planned.reached,
            message=planned.message,
            start=planned.start,
            plan=planned.plan,
            initial_cost=planned.initial_cost,
        )


def main() -> int:
    """Run the node; the exit code."""
    return run_node(MppiPlannerNode)


if __name__ == "__main__":
    sys.exit(main())
