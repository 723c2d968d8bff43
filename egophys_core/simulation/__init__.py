"""Spring-mass rollouts in Warp: a batch of K at once, on the CPU or CUDA from the same kernels."""

from egophys_core.lanes import LANES
from egophys_core.simulation.batch import BatchCodebook, BatchEffect, Nudging, RolloutBatch
from egophys_core.simulation.controls import ContactKind, Controls
from egophys_core.simulation.effect_gradients import effect_gradients
from egophys_core.simulation.frames import into_world
from egophys_core.simulation.model_batch import as_they_were, batch_of_models, spring_order
from egophys_core.simulation.rollout import Rollout, filled_up, rollout

__all__ = [
    "LANES",
    "BatchCodebook",
    "BatchEffect",
    "ContactKind",
    "Controls",
    "Nudging",
    "Rollout",
    "RolloutBatch",
    "as_they_were",
    "batch_of_models",
    "effect_gradients",
    "filled_up",
    "into_world",
    "rollout",
    "spring_order",
]
