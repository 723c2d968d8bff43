"""The service `~/plan_and_execute`: plan, have the arm execute the plan, answer when that is done; and `~/cancel`."""

from egophys_msgs.action import PlanToTarget
from egophys_msgs.srv import PlanAndExecute
from egophys_ros_common.arm_client import ArmClient, PlanExecution
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.worker import CanceledError
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import Trigger

from egophys_core.errors import PlanningError, RobotError
from egophys_planner.planning import Planned, Planning


class PlanAndExecuteServer:
    """One request at a time. Nothing waits on the executor's thread: steps await each other."""

    def __init__(self, node: ManagedNode, planning: Planning) -> None:
        """Create the services and the client of the bridge; the node destroys them at cleanup."""
        self._node = node
        self._planning = planning
        self._is_busy = False
        self._is_canceled = False
        self._arm = ArmClient(node)
        self._execution: PlanExecution | None = None
        waiting = ReentrantCallbackGroup()
        for kind, name, callback in (
            (PlanAndExecute, "~/plan_and_execute", self._serve),
            (Trigger, "~/cancel", self._cancel),
        ):
            node.own(node.create_service(kind, name, callback, callback_group=waiting), node.destroy_service)

    def stop(self) -> None:
        """Have the arm stop; the request is answered when it has."""
        self._is_canceled = True
        if self._execution is not None:
            self._execution.cancel()

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
        self._execution = PlanExecution(self._arm)
        try:
            executed = await self._execution.run(planned.plan)
        except RobotError as error:
            raise RobotError(f"planned, but {error}") from error
        finally:
            self._execution = None
        return str(executed.message)

    def _cancel(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        executing, planning = self._is_busy, self._planning.is_busy
        self._planning.cancel()
        if executing:
            self.stop()
        response.success = executing or planning
        response.message = "it stops at its next step" if response.success else "nothing is planned or executed"
        return response
