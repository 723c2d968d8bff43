"""Running a node as a program: one executor thread, signals that end goals before the node, `--help`."""

import difflib
import signal
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions

from egophys_core.errors import EgophysError
from egophys_ros_common.exit_codes import BAD_PARAMETERS, COULD_NOT_START, CRASHED, ENDED
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters_help import parameters_text

GOALS_END_S = 5.0
"""How long a node that was told to end waits for its goals to be answered; what they do has been stopped before."""
LAST_WORDS_S = 2.0
"""How long a node that could not start stays, so that its reason is heard."""
NOBODY_LISTENS_S = 8.0
"""How long it stays where nobody who listens has been found: on a busy machine that takes long."""
LAST_SPINS, LAST_SPIN_S = 5, 0.02
"""Turns of the executor that send the answers of goals that have just ended."""


def run_node(make: Callable[[], ManagedNode]) -> int:
    """Run a node until SIGINT, SIGTERM or the end of its context; then its goals are ended and answered first.

    One executor thread runs all callbacks, so the node's state needs no locks; work goes to `Worker`s.

    Returns:
        The exit code, see `exit_codes`.
    """
    words = sys.argv[1:]
    own_words = words[: words.index("--ros-args")] if "--ros-args" in words else words
    try:
        # rclpy's handlers would end the context, and with it all goals, unanswered.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = make()
    except (ParameterException, EgophysError, RuntimeError) as error:  # rclpy's RCLError is a RuntimeError
        print(f"{make.__name__}: {error}; --help lists the parameters", file=sys.stderr)
        rclpy.try_shutdown()
        return BAD_PARAMETERS
    except KeyboardInterrupt:
        return ENDED
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        if {"-h", "--help"} & set(own_words):
            print(f"{sys.modules[make.__module__].__doc__}\n\nParameters (-p NAME:=VALUE):\n{parameters_text(node)}")
            return ENDED
        _warn_of_misspelt_parameters(node)
        return _spin(node, executor)
    except ExternalShutdownException:
        return ENDED
    except Exception as error:
        # A callback that was under way when the context ended cannot publish or answer any more.
        if isinstance(error, RuntimeError) and not rclpy.ok():
            return ENDED
        traceback.print_exception(error)
        return CRASHED
    finally:
        node.close()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def _spin(node: ManagedNode, executor: SingleThreadedExecutor) -> int:
    told_to_end = threading.Event()
    with _signals(lambda: node.hand_over(told_to_end.set)):
        if not node.get_parameter("autostart").value:
            node.get_logger().info(
                f"waits to be configured: ros2 lifecycle set {node.get_fully_qualified_name()} configure"
            )
        elif not _started(node):
            _stay_until_heard(node, executor)
            return COULD_NOT_START
        # Not spin_until_future_complete, which adds a callback to the future each time that something happens.
        while rclpy.ok() and not told_to_end.is_set():
            executor.spin_once()
        node.stop_working()
        deadline = time.monotonic() + GOALS_END_S
        while node.open_goals and time.monotonic() < deadline:
            executor.spin_once(LAST_SPIN_S)
        for _ in range(LAST_SPINS):
            executor.spin_once(LAST_SPIN_S)
    return ENDED


def _stay_until_heard(node: ManagedNode, executor: SingleThreadedExecutor) -> None:
    """Whoever records /rosout has to find this node first, and then to receive what it said."""
    began = heard_since = time.monotonic()
    while (now := time.monotonic()) < began + NOBODY_LISTENS_S:
        executor.spin_once(LAST_SPIN_S)
        if node.count_subscribers("/rosout") == 0:
            heard_since = now
        elif now > heard_since + LAST_WORDS_S:
            break


def _warn_of_misspelt_parameters(node: ManagedNode) -> None:
    """ROS drops values of parameters that a node does not have; files of parameters are shared by nodes, so may we."""
    known = node.get_parameters_by_prefix("")
    for name in sorted(set(node._parameter_overrides) - set(known)):
        if near := difflib.get_close_matches(name, known, n=1, cutoff=0.8):
            node.get_logger().warning(f"there is no parameter {name}, so it does nothing; did you mean {near[0]}?")


@contextmanager
def _signals(on_signal: Callable[[], None]) -> Iterator[None]:
    """Call a function, from a thread, at the first SIGINT or SIGTERM.

    A Python handler runs only when the main thread is back from waiting in the middleware, which may take long; what
    `set_wakeup_fd` writes arrives at once.
    """
    here, there = socket.socketpair()
    there.setblocking(False)
    before = signal.set_wakeup_fd(there.fileno(), warn_on_full_buffer=False)
    handlers = [(each, signal.signal(each, lambda number, frame: None)) for each in (signal.SIGINT, signal.SIGTERM)]

    def wait() -> None:
        if here.recv(1):
            on_signal()

    thread = threading.Thread(target=wait, name="signals", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        for number, handler in handlers:
            signal.signal(number, handler)
        there.close()
        thread.join()
        here.close()


def _started(node: ManagedNode) -> bool:
    steps = (node.trigger_configure, node.trigger_activate)
    return all(step() == TransitionCallbackReturn.SUCCESS for step in steps)
