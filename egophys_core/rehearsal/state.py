"""What an injected force sees of the body in one step."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class StepState:
    """The body at the start of a step. SI units, frame `world`."""

    time: float
    """Seconds since the start of the episode; negative while the body settles."""
    duration: float
    """Seconds of the step."""
    positions: np.ndarray
    """[V, 3]."""
    velocities: np.ndarray
    """[V, 3]."""
    masses: np.ndarray
    """[V]."""
    pressures: np.ndarray
    """[V] N with which the table holds each vertex up; zeros unless the force asked for it."""


ForceTerm = Callable[[StepState, np.ndarray], None]
"""Adds its force, N, to the forces [V, 3]; may remember what it needs."""
