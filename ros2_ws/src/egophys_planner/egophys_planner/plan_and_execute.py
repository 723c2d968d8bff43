"""The service `~/plan_and_execute`: plan, have the arm execute the plan, answer when that is done; and `~/cancel`."""

from action_msgs.msg import GoalStatus
from egophys_msgs.action import ExecutePlan, PlanToTarget
from egophys_msgs.srv import PlanAndExecute
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.worker import CanceledError
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from egophys_core.errors import PlanningError, RobotError
from egophys_planner.planning import Planned, Planning

LOOK_PERIOD_S = 0.5
"""How often a waiting service looks whether the bridge has gone."""


class PlanAndExecuteServer:
    """One request at a time. Nothing waits on the executor's thread: steps await each other."""

    def __init__(self, node: ManagedNode, planning: Planning) -> None:
        """Create the services and the client of the bridge; the node destroys them at cleanup."""
        self._node = node
        self._planning = planning
        self._is_busy = False
        self._is_canceled = False
        self._goal: ClientGoalHandle | None = None
        self._action = node.resolve_service_name(node.get_parameter("execute_action").value)
        self._arm = node.own(ActionClient(node, ExecutePlan, self._action), ActionClient.destroy)
        waiting = ReentrantCallbackGroup()
        for kind, name, callback in (
            (PlanAndExecute, "~/plan_and_execute", self._serve),
            (Trigger, "~/cancel", self._cancel),
        ):
            node.own(node.create_service(kind, name, callback, callback_group=waiting), node.destroy_service)

    def stop(self) -> None:
        """Have the arm stop; the request is answered when it has."""
        self._is_canceled = True
        if self._goal is not None:
            self._goal.cancel_goal_async()

    async def _serve(
        self, request: PlanAndExecute.Request, response: PlanAndExecute.Response
    ) -> PlanAndExecute.Response:
        response.initial_cost = response.predicted_cost = float("nan")
        if self._is_busy:
            error = PlanningError("another request is being planned or executed; wait for it, or call ~/cancel")
            response.message = self._node.refuse("plan_and_execute", error)
            return response
        self._is_busy, self._is_canceled = True, False
        try:
            with self._node.goal_open():
                await self._plan_and_execute(request, response)
        except CanceledError as error:
            response.message = f"canceled: {error}"
        except Exception as error:
            response.message = self._node.refuse("plan_and_execute", error)
        finally:
            self._is_busy = False
        return response

    async def _plan_and_execute(self, request: PlanAndExecute.Request, response: PlanAndExecute.Response) -> None:
        goal = PlanToTarget.Goal(target_source=request.target, options_json=request.options_json)
        job = self._planning.begin(goal)
        planned: Planned = await self._planning.run(job)
        response.initial_cost, response.predicted_cost = planned.initial_cost, planned.plan.predicted_cost
        response.reached = planned.reached
        if not planned.reached:
            raise PlanningError(f"nothing was executed: {planned.message}")
        if self._is_canceled:
            raise CanceledError("the plan was made and not executed")
        message = await self._execute(planned)
        response.success, response.message = True, f"{planned.message}; executed: {message}"

    async def _execute(self, planned: Planned) -> str:
        """Have the bridge execute a plan; what it says at the end.

        Raises:
            RobotError: it did not, with its reason.
            CanceledError: it was stopped on request.
        """
        if not self._arm.server_is_ready():
            raise RobotError(f"planned, but no bridge serves {self._action}; is it running and configured?")
        self._goal = await self._unless_gone(self._arm.send_goal_async(ExecutePlan.Goal(plan=planned.plan)))
        try:
            if not self._goal.accepted:
                raise RobotError(f"planned, but {self._action} rejected the plan; the bridge's /diagnostics say why")
            if self._is_canceled:
                self._goal.cancel_goal_async()
            ended = await self._unless_gone(self._goal.get_result_async())
        finally:
            self._goal = None
        if ended.status == GoalStatus.STATUS_SUCCEEDED and ended.result.success:
            return str(ended.result.message)
        if self._is_canceled:
            raise CanceledError(f"the arm was stopped: {ended.result.message}")
        raise RobotError(f"planned, but not executed to its end: {ended.result.message}")

    def _unless_gone(self, answer: Future) -> Future:
        """The answer, or the error that the bridge has gone, after which none will come."""
        result = Future()

        def look() -> None:
            if answer.done() or not self._arm.server_is_ready():
                timer.cancel()
                self._node.destroy_timer(timer)
                if answer.done():
                    return
                gone = RobotError(f"{self._action} has gone while it executed the plan; look after the arm")
                result.set_exception(gone)

        timer = self._node.create_timer(LOOK_PERIOD_S, look)

        def deliver(done: Future) -> None:
            if not result.done():
                result.set_result(done.result())

        answer.add_done_callback(deliver)
        return result

    def _cancel(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        executing, planning = self._is_busy, self._planning.is_busy
        self._planning.cancel()
        if executing:
            self.stop()
        response.success = executing or planning
        response.message = "it stops at its next step" if response.success else "nothing is planned or executed"
        return response
