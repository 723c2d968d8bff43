"""An action that says why not: a goal that cannot be met is accepted and aborted with the reason in its result.

rclpy's own rejection carries no words, and whoever sent the goal would have to look into another process's log.
"""

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Generic, TypeVar

from action_msgs.msg import GoalStatus
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle

from egophys_ros_common.managed_node import ManagedNode

JobT = TypeVar("JobT")

RESULT_KEPT_S = 60
"""How long a result waits for who asks late; rclpy keeps 900 s of measured motions otherwise, 5 MB a minute."""


class GoalServer(Generic[JobT]):
    """Serves one action until the node's cleanup. All functions are called on the executor's thread."""

    def __init__(
        self,
        node: ManagedNode,
        action: Any,
        name: str,
        *,
        noun: str,
        begin: Callable[[ServerGoalHandle], JobT],
        run: Callable[[JobT, ServerGoalHandle], Awaitable[Any]],
        cancel: Callable[[], bool],
    ) -> None:
        """Create the action; the node destroys it at cleanup.

        Args:
            node: that serves it.
            action: its type; the result has the fields `success` and `message`.
            name: of the action.
            noun: what a goal is called in messages, `plan`.
            begin: makes the goal the running job, or raises EgophysError with the reason why it cannot be.
            run: does the job, sets the end of the goal and returns the result; raises nothing.
            cancel: asks the running job to stop; False if none runs.
        """
        self._node = node
        self._action = action
        self._noun = noun
        self._begin = begin
        self._run = run
        self._cancel = cancel
        server = ActionServer(
            node,
            action,
            name,
            self._abort,
            handle_accepted_callback=self._accept,
            cancel_callback=self._cancel_running,
            result_timeout=RESULT_KEPT_S,
        )
        node.own(server, ActionServer.destroy)

    def _accept(self, handle: ServerGoalHandle) -> None:
        try:
            job = self._begin(handle)
        except Exception as error:
            reason = self._node.refuse(f"{self._noun} refused", error)
            handle.execute(partial(self._abort, reason=reason))
        else:
            handle.execute(partial(self._answer, job))

    async def _answer(self, job: JobT, handle: ServerGoalHandle) -> Any:
        with self._node.goal_open():
            return await self._run(job, handle)

    def _cancel_running(self, handle: ServerGoalHandle) -> CancelResponse:
        """Stop the job of this goal, never that of another: rclpy keeps goals that it accepted and could not begin."""
        begun = handle.status == GoalStatus.STATUS_EXECUTING
        return CancelResponse.ACCEPT if begun and self._cancel() else CancelResponse.REJECT

    async def _abort(self, handle: ServerGoalHandle, reason: str = "no job began for this goal") -> Any:
        handle.abort()
        return self._action.Result(success=False, message=reason)
