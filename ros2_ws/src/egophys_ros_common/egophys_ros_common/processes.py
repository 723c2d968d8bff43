"""Installed nodes as processes, and a client that talks to them over DDS from this process: for scripts and tests.

Every wait has a name and a timeout, asks
again until the answer is right, and says what it was waiting for when time is up.
"""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from ament_index_python.packages import get_package_prefix
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_sensor_data

APPEAR_TIMEOUT = 60.0
"""For a process to start and its services to be discovered."""
ANSWER_TIMEOUT = 30.0
"""For a service call, or a goal's acceptance."""
REPLY_PATH_TIME = 0.2
"""For a server to discover a new client, which the client cannot see; a reply before that is lost."""
ATTEMPTS = 3
"""Requests sent within `ANSWER_TIMEOUT` before a node counts as not answering."""
MESSAGE_TIMEOUT = 60.0
"""For a message on a topic."""
RESULT_TIMEOUT = 120.0
"""For the result of an action."""
EXIT_TIMEOUT = 20.0
"""For a process to end after it was told to."""
POLL_INTERVAL = 0.05
LOG_TAIL = 4000
"""Characters of a process's output shown when it fails."""

T = TypeVar("T")


def wait_until(condition: Callable[[], T], timeout: float, what: str) -> T:
    """The first true value of `condition`, asked again and again."""
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise TimeoutError(f"{what} did not happen within {timeout:.0f} s")
        time.sleep(POLL_INTERVAL)
    return value


class NodeProcess:
    """One installed executable, started as `ros2 run PACKAGE EXECUTABLE ARGUMENTS...` would."""

    def __init__(self, package: str, executable: str, arguments: list[str], log: Path) -> None:
        """Start it in this process's environment; what it prints goes to the file `log`."""
        path = Path(get_package_prefix(package), "lib", package, executable)
        if not path.exists():
            raise FileNotFoundError(f"{path} is not installed; run make build")
        self.name = f"{package}/{executable}"
        self._log = log
        self._end_expected = False
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                [path, *arguments], stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT
            )

    @property
    def output(self) -> str:
        """Everything it has printed so far."""
        return self._log.read_text(errors="replace")

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def wait_for_output(self, text: str, timeout: float = APPEAR_TIMEOUT) -> None:
        """Wait until it has printed `text`; for programs that are no nodes. Nodes are asked, not read."""

        def printed() -> bool:
            if not self.alive:
                raise RuntimeError(f"{self.name} has ended:\n{self.output[-LOG_TAIL:]}")
            return text in self.output

        wait_until(printed, timeout, f"{text!r} in the output of {self.name}")

    def memory_mb(self) -> float:
        """Memory that it holds, MB."""
        pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def say(self, line: str) -> None:
        """Write a line to its standard input."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n".encode())
        self._process.stdin.flush()

    def interrupt(self) -> int:
        """Ctrl-C, as a person or launch would; the exit code."""
        return self._end(signal.SIGINT)

    def terminate(self) -> int:
        """SIGTERM; the exit code."""
        return self._end(signal.SIGTERM)

    def kill(self) -> None:
        """SIGKILL: the process cannot tidy up."""
        self._end(signal.SIGKILL)

    def pause(self) -> None:
        """Hang: it stays connected and does nothing until `resume`."""
        self._process.send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        """Go on where `pause` stopped it."""
        self._process.send_signal(signal.SIGCONT)

    def wait_for_end(self, timeout: float = APPEAR_TIMEOUT) -> int:
        """Wait until it ends by itself; the exit code."""
        self._end_expected = True
        return self._process.wait(timeout)

    def stop(self) -> None:
        """End it and insist on exit code 0, unless the test has ended it or has seen its end."""
        if self._end_expected:
            return
        code = self._process.poll() if not self.alive else self.interrupt()
        if code != 0:
            raise RuntimeError(f"{self.name} ended with exit code {code}:\n{self.output[-LOG_TAIL:]}")

    def _end(self, number: signal.Signals) -> int:
        self._end_expected = True
        self._process.send_signal(number)
        try:
            return self._process.wait(EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise TimeoutError(
                f"{self.name} did not end within {EXIT_TIMEOUT:.0f} s of {number.name}:\n{self.output[-LOG_TAIL:]}"
            ) from None


class _Executor(SingleThreadedExecutor):
    """Goes on where another thread destroys what it is about to wait for; rclpy's ends (rclpy issue 1284)."""

    def wait_for_ready_callbacks(self, *args: Any, **kwargs: Any) -> Any:
        """The next callback to execute."""
        while True:
            try:
                return super().wait_for_ready_callbacks(*args, **kwargs)
            except InvalidHandle:
                pass  # nothing has been taken yet, and what is gone is not waited for again


class Client:
    """A node in this process. Its callbacks run on a thread of its own; all methods block, bounded."""

    def __init__(self) -> None:
        """Join the graph; the environment must hold the domain id already."""
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node(f"client_{os.getpid()}", context=self._context)
        self._group = ReentrantCallbackGroup()
        self._action_clients: dict[str, ActionClient] = {}
        self._executor = _Executor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, name="client", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._thread.join(EXIT_TIMEOUT)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def call(self, kind: Any, name: str, request: Any = None, timeout: float = ANSWER_TIMEOUT) -> Any:
        """Call a service, waiting first until it is there; the response."""
        client = self.node.create_client(kind, name, callback_group=self._group)
        try:
            self._wait_for_server(client.service_is_ready, f"service {name}")
            return self._answer(lambda: client.call_async(request or kind.Request()), timeout, f"answer of {name}")
        finally:
            self.node.destroy_client(client)

    def change_state(self, node: str, transition: int) -> bool:
        """Ask a lifecycle node for a transition (`Transition.TRANSITION_*`); whether it succeeded.

        A reply is lost when the server has not discovered the new client yet. The state tells whether the
        transition happened all the same; otherwise it is asked for again.
        """
        before = self.state_of(node)
        request = ChangeState.Request(transition=Transition(id=transition))
        for _ in range(ATTEMPTS):
            try:
                return bool(self.call(ChangeState, f"{node}/change_state", request, ANSWER_TIMEOUT / ATTEMPTS).success)
            except TimeoutError:
                if self.state_of(node) != before:
                    return True
        raise TimeoutError(f"{node} did not answer {ATTEMPTS} requests for transition {transition}")

    def state_of(self, node: str) -> str:
        """Label of a lifecycle node's state: unconfigured, inactive, active or finalized."""
        return wait_until(lambda: self._state(node), ANSWER_TIMEOUT, f"answer of {node}/get_state")

    def wait_for_state(self, node: str, label: str, timeout: float = APPEAR_TIMEOUT) -> None:
        """Wait until a lifecycle node is in a state."""
        wait_until(lambda: self._state(node) == label, timeout, f"{node} {label}")

    def _state(self, node: str) -> str:
        """The state's label, empty if no answer came: the services of a killed node stay in the graph for a while."""
        try:
            return str(self.call(GetState, f"{node}/get_state", timeout=1.0).current_state.label)
        except TimeoutError:
            return ""

    def start(self, node: str) -> None:
        """Configure and activate a lifecycle node."""
        for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
            if not self.change_state(node, transition):
                raise RuntimeError(f"{node} refused transition {transition}; its output says why")

    def set_parameter(self, node: str, name: str, value: Any) -> SetParametersResult:
        """Set a node's parameter, as `ros2 param set` does: `.successful`, and the `.reason` if not."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        (result,) = self.call(SetParameters, f"{node}/set_parameters", request).results
        return result

    def message(
        self,
        kind: Any,
        topic: str,
        condition: Callable[[Any], bool] = lambda _: True,
        qos: QoSProfile = qos_profile_sensor_data,
        timeout: float = MESSAGE_TIMEOUT,
    ) -> Any:
        """The next message on a topic that meets a condition."""
        return self.messages(kind, topic, 1, condition, qos, timeout)[0]

    def messages(
        self,
        kind: Any,
        topic: str,
        count: int,
        condition: Callable[[Any], bool] = lambda _: True,
        qos: QoSProfile = qos_profile_sensor_data,
        timeout: float = MESSAGE_TIMEOUT,
        raw: bool = False,
    ) -> list[Any]:
        """The next `count` messages on a topic that meet a condition, as they were serialized if `raw`."""
        found: list[Any] = []
        arrived = threading.Event()

        def receive(message: Any) -> None:
            if len(found) < count and condition(message):
                found.append(message)
                if len(found) == count:
                    arrived.set()

        subscription = self.node.create_subscription(kind, topic, receive, qos, callback_group=self._group, raw=raw)
        try:
            if not arrived.wait(timeout):
                raise TimeoutError(f"{len(found)} of {count} such messages on {topic} within {timeout:.0f} s")
            return found
        finally:
            self.node.destroy_subscription(subscription)

    def send_goal(
        self, kind: Any, name: str, goal: Any, on_feedback: Callable[[Any], None] | None = None
    ) -> ClientGoalHandle:
        """Send an action goal, waiting first until the server is there; see `.accepted` of the handle."""
        client = self._action_client(kind, name)
        self._wait_for_server(client.server_is_ready, f"action {name}")
        feedback = (lambda message: on_feedback(message.feedback)) if on_feedback else None
        return self._answer(
            lambda: client.send_goal_async(goal, feedback_callback=feedback),
            ANSWER_TIMEOUT,
            f"answer to the goal for {name}",
        )

    def result(self, handle: ClientGoalHandle, timeout: float = RESULT_TIMEOUT) -> Any:
        """What an accepted goal ended with: `.status` (GoalStatus) and `.result`."""
        return self._answer(handle.get_result_async, timeout, "the goal's result")

    def act(self, kind: Any, name: str, goal: Any, timeout: float = RESULT_TIMEOUT) -> Any:
        """Send an action goal and wait for what it ends with, as `result`."""
        return self.result(self.send_goal(kind, name, goal), timeout)

    def cancel(self, handle: ClientGoalHandle) -> Any:
        """Ask for a goal's cancellation; the answer, not the result."""
        return self._answer(handle.cancel_goal_async, ANSWER_TIMEOUT, "answer to the cancellation")

    def _action_client(self, kind: Any, name: str) -> ActionClient:
        if name not in self._action_clients:
            self._action_clients[name] = ActionClient(self.node, kind, name, callback_group=self._group)
        return self._action_clients[name]

    def _wait_for_server(self, is_ready: Callable[[], bool], what: str) -> None:
        wait_until(is_ready, APPEAR_TIMEOUT, what)
        time.sleep(REPLY_PATH_TIME)

    def _answer(self, send: Callable[[], Any], timeout: float, what: str) -> Any:
        """What the future that `send` returns ends with.

        It is sent from the thread that receives: rclpy expects an answer to an action's request only after it
        has sent the request, and ignores one that another thread receives in between.
        """
        sent = self._executor.create_task(send)
        wait_until(sent.done, timeout, f"sending for {what}")
        future = sent.result()
        wait_until(future.done, timeout, what)
        return future.result()
