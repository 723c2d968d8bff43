"""Cores: how much runs side by side."""

import os


def usable_cores() -> int:
    """Cores that this process may use, not all that the machine has."""
    return len(os.sched_getaffinity(0))
