"""The queue of position mode: moves one after the other, and what clients are told of each."""

import enum
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from xarm_bridge.emulator.motion import Move, Place


class TaskEnd(enum.IntEnum):
    """How a task ended, as feedback frames carry it."""

    SUCCESS = 0
    DISCARDED = 2


class TaskEvent(NamedTuple):
    """Something that clients may want to be told."""

    task: int
    """Number of the task since power-up."""
    end: TaskEnd | None
    """None where the task starts."""


class MotionQueue:
    """Plans of moves that wait, and the move that is under way. A plan is made when its turn comes."""

    def __init__(self) -> None:
        self.tasks = 0
        """Number of tasks ever added; also the number of the newest."""
        self.events: deque[TaskEvent] = deque()
        """What happened, oldest first; whoever tells clients takes it out."""
        self._waiting: deque[tuple[int, Callable[[], Move]]] = deque()
        self._move: tuple[int, Move] | None = None
        self._time = 0.0

    def __len__(self) -> int:
        return len(self._waiting) + (self._move is not None)

    def add(self, plan: Callable[[], Move]) -> None:
        """Append a move; `plan` makes it from where the arm stands when the move starts."""
        self.tasks += 1
        self._waiting.append((self.tasks, plan))

    def drop(self) -> None:
        """Forget everything that is not finished."""
        if self._move is not None:
            self.events.append(TaskEvent(self._move[0], TaskEnd.DISCARDED))
        self.events.extend(TaskEvent(task, TaskEnd.DISCARDED) for task, _ in self._waiting)
        self._move = None
        self._waiting.clear()

    def follow(self, elapsed: float) -> tuple[Place, float]:
        """Let seconds pass on the present move, or on the next one if none is under way.

        Returns where the arm is then, and the seconds that were left when the move ended (negative: it did not).
        """
        if self._move is None:
            task, plan = self._waiting[0]
            move = plan()  # may fail; then the task still waits, and is dropped with the others
            self._waiting.popleft()
            self._move, self._time = (task, move), 0.0
            self.events.append(TaskEvent(task, None))
        task, move = self._move
        self._time += elapsed
        left = self._time - move.duration
        if left >= 0:
            self.events.append(TaskEvent(task, TaskEnd.SUCCESS))
            self._move = None
        return move.at(self._time), left
