"""What a process that streams poses does once at its start, so that nothing of its own holds the stream up."""

import gc

from threadpoolctl import threadpool_limits


def keep_timing_even() -> None:
    """Keep the garbage collector and idle threads of the linear algebra from taking the processor for milliseconds.

    A collection of all that was imported takes tens of milliseconds, and OpenBLAS's threads spin after each small
    matrix that they were woken for: gaps of 50 ms in a stream of 10 ms on two cores (docs/notes/streaming.md).
    """
    gc.collect()
    gc.freeze()
    threadpool_limits(limits=1)
