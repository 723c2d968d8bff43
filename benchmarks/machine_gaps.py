"""When the machine itself did not run what was due: a process on each core that only sleeps and looks at the clock."""

import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

import numpy as np

PERIOD_S = 0.002
LATE_S = 0.004
"""A sleeper that comes so much too late was kept waiting by the kernel or the hypervisor."""


class MachineGaps:
    """Times at which a core did not run what was due."""

    def __init__(self) -> None:
        self._spans: list[tuple[float, float]] = []

    def add(self, spans: list[tuple[float, float]]) -> None:
        """Spans [from, to] in seconds since the epoch."""
        self._spans += spans

    def overlap(self, since: np.ndarray, until: np.ndarray) -> np.ndarray:
        """[G] bool: whether the machine had a gap of its own between two times, seconds since the epoch."""
        spans = np.array(self._spans).reshape(-1, 2)
        return np.array(
            [bool(((spans[:, 0] < b) & (spans[:, 1] > a)).any()) for a, b in zip(since, until, strict=True)], bool
        )


@contextmanager
def watched_machine() -> Iterator[MachineGaps]:
    """Watch all cores meanwhile, at the priority of this process; what was seen is there when the block has ended."""
    gaps, watchers = MachineGaps(), []
    spawning = multiprocessing.get_context("spawn")
    for core in sorted(os.sched_getaffinity(0)):
        here, there = spawning.Pipe()
        watchers.append((spawning.Process(target=_watch, args=(core, there), daemon=True), here))
        watchers[-1][0].start()
    try:
        yield gaps
    finally:
        for process, pipe in watchers:
            pipe.send("end")
            gaps.add(pipe.recv())
            process.join()


def _watch(core: int, pipe: Connection) -> None:
    os.sched_setaffinity(0, {core})
    late, last = [], time.time()
    while not pipe.poll():
        time.sleep(PERIOD_S)
        now = time.time()
        if now - last > PERIOD_S + LATE_S:
            late.append((last, now))
        last = now
    pipe.send(late)
