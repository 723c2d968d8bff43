"""What a process does before it streams poses, so that nothing of its own holds the stream up."""

import gc
import sys

from threadpoolctl import threadpool_limits

SWITCH_S = 0.001
"""How long another thread may keep the interpreter from the one that streams; Python's own 5 ms are half a period."""


def keep_timing_even() -> None:
    """Keep the garbage collector and idle threads of the linear algebra from taking the processor for long from now on.

    A collection of all that there is takes tens of milliseconds, so it is done here, and what is left is not looked at
    again until the next call. OpenBLAS's threads spin after each small matrix that they were woken for: gaps of 50 ms
    in a stream of 10 ms on two cores (docs/notes/streaming.md).
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()
    threadpool_limits(limits=1)
    sys.setswitchinterval(SWITCH_S)
