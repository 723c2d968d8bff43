"""From observed episodes to a twin."""

from egophys_core.identification.build import (
    Progress,
    build_twin,
    episode_digest,
    evaluate_twin,
    first_grasp,
    predict,
)
from egophys_core.identification.contact import find_hands, hold_flags
from egophys_core.identification.options import FitOptions, KindChoice
from egophys_core.identification.problem import FitProblem, prepare

__all__ = [
    "FitOptions",
    "FitProblem",
    "KindChoice",
    "Progress",
    "build_twin",
    "episode_digest",
    "evaluate_twin",
    "find_hands",
    "first_grasp",
    "hold_flags",
    "predict",
    "prepare",
]
