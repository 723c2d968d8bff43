"""From observed episodes to a twin."""

from typing import TYPE_CHECKING

from egophys_core.identification.options import FitOptions
from egophys_core.on_demand import names_on_demand

if TYPE_CHECKING:
    from egophys_core.identification.building import beside_baselines, build, episode_digest, evaluate_twin, predict
    from egophys_core.identification.fit import Progress
    from egophys_core.identification.surface_fit import first_grasp

__all__ = [
    "FitOptions",
    "Progress",
    "beside_baselines",
    "build",
    "episode_digest",
    "evaluate_twin",
    "first_grasp",
    "predict",
]

__getattr__ = names_on_demand(__name__, "building", "fit", "surface_fit")
