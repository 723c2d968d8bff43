"""A world that is not ours: soft bodies in MuJoCo, handled by scripted hands, with any effect planted."""

from typing import TYPE_CHECKING

from egophys_core.on_demand import names_on_demand
from egophys_core.rehearsal.options import Motion, RehearsalObject, RehearsalOptions

if TYPE_CHECKING:
    from egophys_core.rehearsal.live import RehearsalWorld
    from egophys_core.rehearsal.planting import PLANTS, Plant, complete_effects, planted_sizes
    from egophys_core.rehearsal.world import rehearse

__all__ = [
    "PLANTS",
    "Motion",
    "Plant",
    "RehearsalObject",
    "RehearsalOptions",
    "RehearsalWorld",
    "complete_effects",
    "planted_sizes",
    "rehearse",
]

__getattr__ = names_on_demand(__name__, "live", "planting", "world")
