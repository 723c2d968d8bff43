"""Threads that roll out on one GPU take turns.

There a frame is recorded as a graph: what another thread launched meanwhile would become part of it, and every launch
after that would fail.
"""

from contextlib import AbstractContextManager, nullcontext
from threading import RLock

import warp as wp

_GPU = RLock()


def turn_on(device: str) -> AbstractContextManager[object]:
    """To be held while anything is launched on a device; threads run side by side on a CPU."""
    return nullcontext() if wp.get_device(device).is_cpu else _GPU
