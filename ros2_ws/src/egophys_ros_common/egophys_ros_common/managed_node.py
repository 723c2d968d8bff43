"""ManagedNode: a lifecycle node whose transitions say what failed, with health and worker threads."""

import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from egophys_core.errors import EgophysError
from egophys_ros_common.worker import CanceledError

HEALTH_PERIOD_S = 1.0

T = TypeVar("T")


class ManagedNode(LifecycleNode):
    """Base of the nodes. A subclass overrides `configure`, `activate`, `deactivate`, `status`, `fault` and `health`.

    `deactivate` is called in any state after `configure`; it also undoes a failed activation. What
    `configure` makes goes through `own`, which destroys it at cleanup: the node can be configured again.

    A parameter is set at once, or refused while the node is active. One that is changed while the node is inactive
    acts from the next activation on, for which the node is configured anew.
    """

    def __init__(self, name: str) -> None:
        """Declare `autostart` and start to report health."""
        super().__init__(name)
        self.is_active = False
        self.last_error = ""
        self.acts_at_once: set[str] = set()
        """Names of parameters that are read for each request, so that they can be set at any time."""
        self.open_goals = 0
        """Goals of actions that have not been answered."""
        self._configured_with: dict[str, Any] = {}
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
        self.add_on_set_parameters_callback(self._check_parameters)
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

    def fault(self) -> str:
        """What keeps the node from working until someone mends it, empty if nothing: an error in `/diagnostics`."""
        return ""

    def health(self) -> dict[str, str]:
        """What `/diagnostics` says, once configured, besides the state and the last error."""
        return {}

    def opening_line(self) -> str:
        """What the node says in the log, once, when it has become active."""
        return ", ".join([self.status(), *(f"{key}: {value}" for key, value in self.health().items() if value)])

    def diagnostic(self, values: dict[str, str]) -> DiagnosticStatus:
        """How the node is: an error if it has a fault, a warning if something was refused or failed."""
        fault = self.fault() if self._is_configured else ""
        level = DiagnosticStatus.WARN if self.last_error else DiagnosticStatus.OK
        return DiagnosticStatus(
            level=DiagnosticStatus.ERROR if fault else level,
            name=self.get_fully_qualified_name(),
            message=fault or self.last_error or self.status(),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

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

    @contextmanager
    def goal_open(self) -> Iterator[None]:
        """Count a goal as not answered meanwhile."""
        self.open_goals += 1
        try:
            yield
        finally:
            self.open_goals -= 1

    def stop_working(self) -> None:
        """Be inactive, and wait until what runs has ended; its results still have to be delivered."""
        self.is_active = False
        if self._is_configured:
            self.deactivate()

    def close(self) -> None:
        """Stop, and destroy what `configure` made."""
        try:
            self.stop_working()
        finally:
            self._release_resources()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure, or stay unconfigured."""
        return self._attempt("configure", self._configure, undo=self._release_resources)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate, or stay inactive."""
        result = self._attempt("activate", self._activate, undo=self._undo_activation)
        self.is_active = result == TransitionCallbackReturn.SUCCESS
        if self.is_active:
            self.last_error = ""
            self.get_logger().info(self.opening_line())
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop working."""
        return self._attempt("deactivate", self.stop_working)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Be as before configuring."""
        return self._attempt("clean up", self._release_resources)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop for good; what `configure` made goes with the process, for pending answers still need it."""
        return self._attempt("shut down", self.stop_working)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Be as before configuring, whatever failed."""
        return self._attempt("recover", self.close)

    def _configure(self) -> None:
        self.configure()
        self._is_configured, self._configured_with = True, self._lasting_parameters()

    def _activate(self) -> None:
        if not self._is_configured or self._configured_with != self._lasting_parameters():
            self._release_resources()
            self._configure()
        self.activate()

    def _undo_activation(self) -> None:
        if self._is_configured:
            self.stop_working()
        else:
            self._release_resources()

    def _lasting_parameters(self) -> dict[str, Any]:
        """Values of the parameters that act for a whole activation."""
        parameters = self.get_parameters_by_prefix("").items()
        return {name: each.value for name, each in parameters if name not in self.acts_at_once}

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        for each in parameters:
            lasts = each.name not in self.acts_at_once and each.name != "use_sim_time"
            if self.is_active and lasts and each.value != self.get_parameter(each.name).value:
                me = self.get_fully_qualified_name()
                reason = (
                    f"{each.name} of {me} acts from its activation on, and it is active: deactivate first (ros2 "
                    f"lifecycle set {me} deactivate), set it, activate"
                )
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

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
        message = DiagnosticArray(status=[self.diagnostic(values)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
