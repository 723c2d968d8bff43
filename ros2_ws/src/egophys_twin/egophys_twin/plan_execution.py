"""Having the bridge execute a plan, for a worker thread that may wait for it."""

from concurrent.futures import Future
from typing import Any

from action_msgs.msg import GoalStatus
from egophys_msgs.action import ExecutePlan
from egophys_msgs.msg import WaypointPlan
from egophys_ros_common.managed_node import ManagedNode
from nav_msgs.msg import Path
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle

from egophys_core.errors import RobotError


class PlanExecution:
    """One plan under way, whose methods are called on a worker's thread.

    Requests are sent from the executor's: rclpy ignores an answer that it receives before the sender expects it.
    """

    def __init__(self, node: ManagedNode, arm: ActionClient, action: str) -> None:
        """Send nothing yet; `arm` is the client of the action of that full name."""
        self._node = node
        self._arm = arm
        self._action = action
        self._answer: Future[Any] = Future()
        self._goal: ClientGoalHandle | None = None
        self._is_canceled = False

    def begin(self, plan: WaypointPlan) -> None:
        """Send the plan.

        Raises:
            RobotError: no bridge is there.
        """
        require_bridge(self._arm, self._action)
        self._node.hand_over(lambda: self._node.executor.create_task(self._execute(plan)))

    def cancel(self) -> None:
        """Have the arm stop."""
        self._node.hand_over(self._cancel)

    def ended(self) -> bool:
        """Whether the plan has ended.

        Raises:
            RobotError: the bridge has gone, after which no answer will come.
        """
        if not self._answer.done() and not self._arm.server_is_ready():
            raise RobotError(f"{self._action} has gone while it executed a motion; look after the arm")
        return self._answer.done()

    def executed(self) -> Path:
        """The measured poses of the tool, of a plan that has ended.

        Raises:
            RobotError: the plan was not executed to its end, with the bridge's reason.
        """
        ended = self._answer.result()
        if ended.status != GoalStatus.STATUS_SUCCEEDED or not ended.result.success:
            raise RobotError(f"the arm did not do the motion that was asked for: {ended.result.message}")
        return ended.result.executed

    async def _execute(self, plan: WaypointPlan) -> None:
        try:
            self._goal = await self._arm.send_goal_async(ExecutePlan.Goal(plan=plan))
            if not self._goal.accepted:
                raise RobotError(f"{self._action} rejected a motion that was asked for; its /diagnostics say why")
            if self._is_canceled:
                self._cancel()
            self._answer.set_result(await self._goal.get_result_async())
        except Exception as error:
            self._answer.set_exception(error)

    def _cancel(self) -> None:
        self._is_canceled = True
        if self._goal is not None:
            self._goal.cancel_goal_async()


def require_bridge(arm: ActionClient, action: str) -> None:
    """Check that a bridge serves the action of that full name.

    Raises:
        RobotError: none does.
    """
    if not arm.server_is_ready():
        raise RobotError(f"no bridge serves {action}, so no arm can do a motion; is it running and configured?")
