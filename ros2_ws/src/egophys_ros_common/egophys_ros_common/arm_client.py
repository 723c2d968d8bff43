"""The bridge as its clients use it: a plan is executed to its end, or an error says why not; no wait is endless."""

import time
from uuid import uuid4

from action_msgs.msg import GoalStatus
from egophys_msgs.action import ExecutePlan
from egophys_msgs.msg import WaypointPlan
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from egophys_core.errors import RobotError
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.worker import CanceledError

LOOK_PERIOD_S = 0.2
"""How often a wait looks whether the bridge has gone."""
ANSWER_S = 5.0
"""For the bridge to say whether it takes a plan; it says so at once."""
ASK_AGAIN_S = 30.0
"""After so long a result is asked for again, for an answer can be lost; to ask again costs nothing."""
ATTEMPTS = 3
"""How often a plan is sent that the bridge seems not to have got."""


class ArmClient:
    """Sends plans to the bridge whose action the node's parameter `execute_action` names."""

    def __init__(self, node: ManagedNode) -> None:
        """Create the client of the action; the node destroys it at cleanup."""
        self.node = node
        self.name = node.resolve_service_name(node.get_parameter("execute_action").value)
        self.action = node.own(ActionClient(node, ExecutePlan, self.name), ActionClient.destroy)

    def require_bridge(self) -> None:
        """Check that a bridge is there.

        Raises:
            RobotError: none is.
        """
        if not self.action.server_is_ready():
            raise RobotError(f"no bridge serves {self.name}, so no arm moves; is it running and configured?")


class PlanExecution:
    """One plan under way. All methods are called on the executor's thread."""

    def __init__(self, arm: ArmClient) -> None:
        """Send nothing yet."""
        self._arm = arm
        self._goal: ClientGoalHandle | None = None
        self._is_canceled = False

    async def run(self, plan: WaypointPlan) -> ExecutePlan.Result:
        """Have a plan executed to its end.

        Raises:
            RobotError: it was not, with the reason.
            CanceledError: it was canceled before its end.
        """
        self._arm.require_bridge()
        self._goal = await self._taken(plan)
        if not self._goal.accepted:
            raise RobotError(f"{self._arm.name} rejected the plan; the bridge's /diagnostics say why")
        if self._is_canceled:
            self._goal.cancel_goal_async()
        ended = None
        while ended is None:
            ended = await self._unless_gone(self._goal.get_result_async(), ASK_AGAIN_S)
        if ended.status == GoalStatus.STATUS_SUCCEEDED and ended.result.success:
            return ended.result
        if self._is_canceled:
            raise CanceledError(f"the arm was stopped: {ended.result.message}")
        raise RobotError(f"the plan was not executed to its end: {ended.result.message}")

    def cancel(self) -> None:
        """Have the arm stop."""
        self._is_canceled = True
        if self._goal is not None:
            self._goal.cancel_goal_async()

    async def _taken(self, plan: WaypointPlan) -> ClientGoalHandle:
        """Send a plan; the bridge's answer to it.

        Where the bridge's middleware has not found this client yet, the answer is lost, and rclpy's server then keeps
        the goal as accepted and never begins it. Such a goal is canceled and sent anew; one that did begin is not.
        """
        for _ in range(ATTEMPTS):
            goal_id = UUID(uuid=list(uuid4().bytes))
            sent = self._arm.action.send_goal_async(ExecutePlan.Goal(plan=plan), goal_uuid=goal_id)
            if answer := await self._unless_gone(sent, ANSWER_S):
                return answer
            unanswered = ClientGoalHandle(
                self._arm.action, goal_id, ExecutePlan.Impl.SendGoalService.Response(accepted=True)
            )
            canceled = await self._unless_gone(unanswered.cancel_goal_async(), ANSWER_S)
            if canceled is None or canceled.goals_canceling:
                break
        raise RobotError(
            f"{self._arm.name} did not say within {ANSWER_S:g} s that it takes the plan, and was told to stop; look "
            "after the arm, and ask again"
        )

    def _unless_gone(self, answer: Future, within_s: float) -> Future:
        """The answer, None if it takes longer, or the error that the bridge has gone, after which none will come."""
        result, node = Future(), self._arm.node
        deadline = time.monotonic() + within_s

        def look() -> None:
            if not result.done() and not self._arm.action.server_is_ready():
                gone = RobotError(f"{self._arm.name} has gone while it had the plan; look after the arm")
                result.set_exception(gone)
            elif not result.done() and time.monotonic() > deadline:
                result.set_result(None)
            if result.done():
                timer.cancel()
                node.destroy_timer(timer)

        timer = node.create_timer(LOOK_PERIOD_S, look)

        def deliver(done: Future) -> None:
            if not result.done():
                result.set_result(done.result())

        answer.add_done_callback(deliver)
        return result
