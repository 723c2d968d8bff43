"""Slow measurements side by side: one process a core, results as they come."""

import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def side_by_side(
    measure: Callable[[Item], Result], items: Iterable[Item], *, minutes: float = 1e9, workers: int | None = None
) -> Iterator[tuple[Item, Result]]:
    """Each item and what was measured of it, in the order in which they are done.

    Args:
        measure: what a new process can import.
        minutes: begin no further item after this long.
        workers: processes at most, if fewer than there are cores.
    """
    end = time.monotonic() + 60.0 * minutes
    cores = sorted(os.sched_getaffinity(0))[:workers]
    waiting = iter(items)
    running: dict[Future[Result], Item] = {}
    # Forked processes would inherit locks of the simulator's threads.
    context = multiprocessing.get_context("spawn")
    free = context.SimpleQueue()
    for core in cores:
        free.put(core)
    with ProcessPoolExecutor(len(cores), mp_context=context, initializer=_stay_on_one, initargs=(free,)) as pool:
        while True:
            if time.monotonic() < end:
                running |= {pool.submit(measure, item): item for item in islice(waiting, len(cores) - len(running))}
            if not running:
                return
            for done in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(done), done.result()


def _stay_on_one(free: "multiprocessing.SimpleQueue[int]") -> None:
    """Keep to a core of its own: a process starts as many threads as it has cores."""
    os.sched_setaffinity(0, {free.get()})
