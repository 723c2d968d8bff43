"""What a fit ends with, whichever way the object was seen."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from egophys_core.observation import FitProblem
from egophys_core.twin import ObjectModel

Progress = Callable[[str, float, float], None]
"""Called with stage, share of the whole done (0..1), best loss so far (metres); may raise to stop the build."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A model, and what else a twin of it needs."""

    model: ObjectModel
    grasp: np.ndarray
    """[C, 3] float32 metres, of the twin."""
    problem: FitProblem
    """The model in the first episode."""
    loss: float
    """Metres."""
    settings: dict[str, Any]
    """What decided the fit, by name, as JSON types."""
