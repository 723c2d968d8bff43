"""Computing beside the executor: callbacks await what a worker thread does."""

from collections.abc import Callable
from concurrent import futures
from typing import Any

from rclpy.task import Future


class CanceledError(Exception):
    """Work was stopped because someone asked for it; not a failure."""


class Worker:
    """One thread that does one thing after another. Callbacks `await worker.run(...)`.

    A callback that awaits must be in a ReentrantCallbackGroup, or nothing else of its group runs meanwhile.
    """

    def __init__(self, name: str, hand_over: Callable[..., None]) -> None:
        """Start without work.

        Args:
            name: of the thread.
            hand_over: runs a function with arguments on the executor's thread (`ManagedNode.hand_over`).
        """
        self._pool = futures.ThreadPoolExecutor(1, thread_name_prefix=name)
        self._hand_over = hand_over
        self._pending: set[futures.Future[Any]] = set()

    def run(self, function: Callable[[], Any]) -> Future:
        """Queue a function; the future gives its result or exception, `CanceledError` if it never started."""
        answer = Future()

        def deliver(done: futures.Future[Any]) -> None:
            self._pending.discard(done)
            if done.cancelled():
                self._hand_over(answer.set_exception, CanceledError("the node was deactivated"))
            elif error := done.exception():
                self._hand_over(answer.set_exception, error)
            else:
                self._hand_over(answer.set_result, done.result())

        work = self._pool.submit(function)
        self._pending.add(work)
        work.add_done_callback(deliver)
        return answer

    def stop(self) -> None:
        """Drop what has not started and wait for what runs, which should have been told to end."""
        pending = list(self._pending)
        for work in pending:
            work.cancel()
        futures.wait(pending)

    def close(self) -> None:
        """Stop for good, and end the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)
