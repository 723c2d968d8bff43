"""Spring-mass rollouts in Warp: a batch of K at once, on the CPU or CUDA from the same kernels."""

from egophys_core.simulation.batch import RolloutBatch, batch_of_models
from egophys_core.simulation.controls import Controls
from egophys_core.simulation.rollout import Rollout, rollout

__all__ = ["Controls", "Rollout", "RolloutBatch", "batch_of_models", "rollout"]
