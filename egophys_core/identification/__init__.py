"""From observed episodes to a twin."""

from typing import TYPE_CHECKING

from egophys_core.identification.options import FitOptions, KindChoice
from egophys_core.on_demand import names_on_demand

if TYPE_CHECKING:
    from egophys_core.identification.build import (
        Progress,
        build_twin,
        episode_digest,
        evaluate_twin,
        first_grasp,
        predict,
    )

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

__getattr__ = names_on_demand(__name__, "build")
