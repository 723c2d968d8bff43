"""From observed episodes to a twin."""

from egophys_core.identification.building import build, episode_digest, evaluate_twin, predict
from egophys_core.identification.fit import Progress
from egophys_core.identification.options import FitOptions
from egophys_core.identification.surface_fit import first_grasp

__all__ = [
    "FitOptions",
    "Progress",
    "build",
    "episode_digest",
    "evaluate_twin",
    "first_grasp",
    "predict",
]
