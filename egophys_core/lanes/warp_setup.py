"""Starting Warp quietly; imported before anything that uses it."""

import os
import sys
from ctypes.util import find_library

import warp as wp

wp.config.log_level = wp.LOG_WARNING


def _start() -> None:
    """Initialise Warp. Without a CUDA driver it writes a warning to file descriptor 2 on every start: drop that."""
    if find_library("cuda") is not None:
        wp.init()
        return
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


_start()
