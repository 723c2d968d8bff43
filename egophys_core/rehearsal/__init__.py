"""A world that is not ours: soft bodies in MuJoCo, handled by scripted hands, with any effect planted."""

from egophys_core.rehearsal.live import RehearsalWorld
from egophys_core.rehearsal.options import Motion, RehearsalObject, RehearsalOptions
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
