"""Spring-mass rollouts in Warp: a batch of K at once, on the CPU or CUDA from the same kernels."""

from egophys_core.simulation.batch import RolloutBatch
from egophys_core.simulation.controls import ContactKind, Controls
from egophys_core.simulation.frames import into_world
from egophys_core.simulation.lanes import LANES
from egophys_core.simulation.model_batch import batch_of_models, spring_order
from egophys_core.simulation.rollout import Rollout, rollout
from egophys_core.simulation.terms.force_effect import ForceEffect
from egophys_core.simulation.terms.loads import with_actions

__all__ = [
    "LANES",
    "ContactKind",
    "Controls",
    "ForceEffect",
    "Rollout",
    "RolloutBatch",
    "batch_of_models",
    "into_world",
    "rollout",
    "spring_order",
    "with_actions",
]
