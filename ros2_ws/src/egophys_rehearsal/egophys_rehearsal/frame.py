"""What the rehearsal shows at one time, and who shows it. Imports no ROS."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True, kw_only=True)
class RehearsalFrame:
    """One look at object and hands. Frame `world`."""

    stamp_ns: int
    """Nanoseconds since the epoch."""
    points: np.ndarray
    """[N, 3] float32, metres: the object's points; NaN where not seen."""
    hands: np.ndarray
    """[C, 3] metres: points of the hands, or of the tool."""


class Stage(Protocol):
    """Where the object lies and is handled."""

    def due(self, now_ns: int) -> Callable[[], RehearsalFrame] | None:
        """What makes the next frame, to be called on a worker thread; None while none is due.

        It must have returned before the next call.
        """

    def status(self, now_ns: int) -> str:
        """What is done, or waited for."""
