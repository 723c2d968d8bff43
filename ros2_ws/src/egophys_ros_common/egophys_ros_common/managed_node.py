"""ManagedNode: a lifecycle node whose transitions say what failed, with health and worker threads."""

import signal
import traceback
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from egophys_core.errors import EgophysError
from egophys_ros_common.worker import CanceledError

HEALTH_PERIOD_S = 1.0

T = TypeVar("T")


class ManagedNode(LifecycleNode):
    """Base of the nodes. A subclass overrides `configure`, `activate`, `deactivate`, `status` and `health`.

    `deactivate` is called in any state after `configure`; it also undoes a failed activation. What
    `configure` makes goes through `own`, which destroys it at cleanup: the node can be configured again.
    """

    def __init__(self, name: str) -> None:
        """Declare `autostart` and start to report health."""
        super().__init__(name)
        self.is_active = False
        self.last_error = ""
        self._is_configured = False
        self._resources = ExitStack()
        self._handed_over: deque[Callable[[], None]] = deque()
        self.declare_parameter(
            "autostart",
            False,
            ParameterDescriptor(
                description="configure and activate by itself at start, where no launch file does it",
                read_only=True,
            ),
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(HEALTH_PERIOD_S, self._publish_health)

    def configure(self) -> None:
        """Read parameters and make publishers, services and the like; raise to refuse."""

    def activate(self) -> None:
        """Begin to work; raise to refuse."""

    def deactivate(self) -> None:
        """Stop working and wait until that is so."""

    def status(self) -> str:
        """What the node does now, a sentence for `/diagnostics` while nothing has failed."""
        return "active" if self.is_active else "not active"

    def health(self) -> dict[str, str]:
        """What `/diagnostics` says, once configured, besides the state and the last error."""
        return {}

    def own(self, entity: T, destroy: Callable[[T], Any]) -> T:
        """Return `entity`, to be destroyed at cleanup."""
        self._resources.callback(destroy, entity)
        return entity

    def hand_over(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Run a function on the executor's thread, in the order of the calls; from any thread."""
        self._handed_over.append(partial(function, *arguments))
        if self.executor is not None:
            # The executor runs its newest task first; the queue keeps the order.
            self.executor.create_task(self._run_handed_over)

    def refuse(self, what: str, error: Exception) -> str:
        """Log and remember why something was refused or failed, with traceback unless the user can mend it.

        Returns:
            What to answer.
        """
        if isinstance(error, EgophysError | CanceledError):
            self.last_error = f"{what}: {error}"
            self.get_logger().error(self.last_error)
            return str(error)
        self.last_error = f"{what}: {type(error).__name__}: {error}"
        self.get_logger().error(f"{what}:\n{''.join(traceback.format_exception(error))}")
        return f"internal error, see the log of {self.get_name()}: {type(error).__name__}: {error}"

    def close(self) -> None:
        """Stop, and destroy what `configure` made."""
        try:
            self._stop_working()
        finally:
            self._release_resources()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure, or stay unconfigured."""
        result = self._attempt("configure", self.configure, undo=self._release_resources)
        self._is_configured = result == TransitionCallbackReturn.SUCCESS
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate, or stay inactive."""
        result = self._attempt("activate", self.activate, undo=self._stop_working)
        self.is_active = result == TransitionCallbackReturn.SUCCESS
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop working."""
        return self._attempt("deactivate", self._stop_working)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Be as before configuring."""
        return self._attempt("clean up", self._release_resources)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop for good; what `configure` made goes with the process, for pending answers still need it."""
        return self._attempt("shut down", self._stop_working)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Be as before configuring, whatever failed."""
        return self._attempt("recover", self.close)

    def _stop_working(self) -> None:
        self.is_active = False
        if self._is_configured:
            self.deactivate()

    def _release_resources(self) -> None:
        self._is_configured = False
        self._resources.close()

    def _attempt(
        self, what: str, action: Callable[[], None], undo: Callable[[], None] | None = None
    ) -> TransitionCallbackReturn:
        """Run a transition; rclpy drops its exceptions, so they are logged here."""
        try:
            action()
        except Exception as error:
            self.refuse(f"cannot {what}", error)
            if undo is None or self._attempt(f"undo {what}", undo) != TransitionCallbackReturn.SUCCESS:
                return TransitionCallbackReturn.ERROR
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def _run_handed_over(self) -> None:
        try:
            self._handed_over.popleft()()
        except Exception as error:
            self.refuse("a result of a worker", error)

    def _publish_health(self) -> None:
        details = self.health() if self._is_configured else {}
        values = {"active": str(self.is_active), **details, "last error": self.last_error}
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if self.last_error else DiagnosticStatus.OK,
            name=self.get_fully_qualified_name(),
            message=self.last_error or self.status(),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def run_node(make: Callable[[], ManagedNode]) -> int:
    """Run a node until SIGINT, SIGTERM or the end of its context.

    One executor thread runs all callbacks, so the node's state needs no locks; work goes to `Worker`s.

    Returns:
        Exit code: 0, or 1 if the node was to start by itself and could not.
    """
    # rclpy ends the context on SIGINT. Python's own handler would also raise in the middle of whatever runs.
    signal.signal(signal.SIGINT, lambda number, frame: None)
    rclpy.init()
    node = make()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        if node.get_parameter("autostart").value and not _started(node):
            return 1
        executor.spin()
    except ExternalShutdownException:
        pass
    except RuntimeError:  # rclpy's RCLError is one
        # A callback that was under way when a signal ended the context cannot publish or answer any more.
        if rclpy.ok():
            raise
    finally:
        node.close()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _started(node: ManagedNode) -> bool:
    steps = (node.trigger_configure, node.trigger_activate)
    return all(step() == TransitionCallbackReturn.SUCCESS for step in steps)
