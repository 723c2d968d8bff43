"""From observed episodes to a twin."""

from egophys_core.identification.build import (
    Progress,
    build_twin,
    episode_digest,
    evaluate_twin,
    first_grasp,
    predict,
)
from egophys_core.identification.options import FitOptions, KindChoice

__all__ = [
    "FitOptions",
    "KindChoice",
    "Progress",
    "build_twin",
    "episode_digest",
    "evaluate_twin",
    "first_grasp",
    "predict",
]
