"""A world that is not ours: soft bodies in MuJoCo, handled by scripted hands, with any effect injected."""

from typing import TYPE_CHECKING

from egophys_core.on_demand import names_on_demand
from egophys_core.rehearsal.options import Motion, RehearsalObject, RehearsalOptions

if TYPE_CHECKING:
    from egophys_core.rehearsal.injection import INJECTABLE, InjectableEffect, complete_effects, injected_sizes
    from egophys_core.rehearsal.live import RehearsalWorld
    from egophys_core.rehearsal.world import rehearse, rehearse_body, rehearse_plans

__all__ = [
    "INJECTABLE",
    "InjectableEffect",
    "Motion",
    "RehearsalObject",
    "RehearsalOptions",
    "RehearsalWorld",
    "complete_effects",
    "injected_sizes",
    "rehearse",
    "rehearse_body",
    "rehearse_plans",
]

__getattr__ = names_on_demand(__name__, "injection", "live", "world")
