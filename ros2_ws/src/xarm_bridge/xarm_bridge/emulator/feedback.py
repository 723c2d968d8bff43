"""Frames that tell a client on its command connection when its motions start and end, if it asked for them.

From firmware 2.0.102 on the SDK asks for them around every motion with wait=True. The layout is the one that the SDK
documents at `register_feedback_callback`.
"""

import asyncio
import struct
from collections import deque
from dataclasses import dataclass

from xarm_bridge.emulator.motion_queue import TaskEnd, TaskEvent
from xarm_bridge.emulator.protocol import Request

SET_TYPES = 254
"""The register that chooses what a connection is told; here it belongs to the connection, not to the arm."""
STARTS, ENDS = 1, 2
"""Bits of that choice; the others (tasks that are no motion) never happen here."""

MARK = 0xFF
"""Stands where replies have their register."""
FRAME = struct.Struct(">HHHBBBBHBQ")
HEADER_SIZE = 6


@dataclass(frozen=True, slots=True)
class _Asked:
    client: asyncio.StreamWriter
    request: Request
    types: int


class Feedback:
    """Who wants to be told of what."""

    def __init__(self) -> None:
        self._types: dict[asyncio.StreamWriter, int] = {}
        self._asked: dict[int, _Asked] = {}

    def choose(self, client: asyncio.StreamWriter, types: int) -> None:
        """What a connection wants to be told of its later commands; 0 for nothing."""
        self._types[client] = types

    def forget(self, client: asyncio.StreamWriter) -> None:
        """The connection is gone."""
        self._types.pop(client, None)
        self._asked = {task: asked for task, asked in self._asked.items() if asked.client is not client}

    def expect(self, task: int, client: asyncio.StreamWriter, request: Request) -> None:
        """A request queued a task."""
        if types := self._types.get(client, 0) & (STARTS | ENDS):
            self._asked[task] = _Asked(client, request, types)

    def frames(self, events: deque[TaskEvent], now: float) -> list[tuple[asyncio.StreamWriter, bytes]]:
        """Take out what happened by a time in seconds: connections and what to tell them."""
        told = []
        while events:
            task, end = events.popleft()
            asked = self._asked.get(task) if end is None else self._asked.pop(task, None)
            kind = STARTS if end is None else ENDS
            if asked and asked.types & kind:
                told.append((asked.client, _encode(asked.request, kind, task, end or TaskEnd.SUCCESS, now)))
        return told


def _encode(request: Request, kind: int, task: int, end: TaskEnd, now: float) -> bytes:
    return FRAME.pack(
        request.transaction,
        request.protocol,
        FRAME.size - HEADER_SIZE,
        MARK,
        0,
        kind,
        request.register,
        task & 0xFFFF,
        end,
        int(now * 1e6),
    )
