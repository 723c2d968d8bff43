"""The path of the code that a GPU takes, on the CPU device."""

import numpy as np

from egophys_core.simulation import RolloutBatch
from egophys_core.simulation.device_arrays import substep_arrays
from egophys_core.simulation.engine import Engine
from egophys_core.simulation.frame_advance import advance_by_substeps


def advance_by_launches(batch: RolloutBatch) -> tuple[np.ndarray, tuple[str | None, ...]]:
    """Positions [K, F, N, 3], metres, and failures of a rollout with some launches a substep."""
    engine = Engine(batch, "cpu")
    shape = (engine.groups, engine.nodes, engine.controllers.shape[2], "cpu")
    out = (substep_arrays(*shape), substep_arrays(*shape))
    engine.advance = lambda state, substeps, inputs: advance_by_substeps(state, substeps, inputs, out)
    frames = [engine.node_positions().copy()]
    for frame in range(len(engine.times) - 1):
        engine.advance_frame(frame)
        frames.append(engine.node_positions().copy())
    return np.stack(frames, axis=1), tuple(engine.failures)
