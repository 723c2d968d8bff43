"""The path of the code that a GPU takes, on the CPU device."""

import numpy as np

from egophys_core.lanes import pack, unpack
from egophys_core.simulation import RolloutBatch
from egophys_core.simulation.device_arrays import substep_arrays
from egophys_core.simulation.engine import Engine
from egophys_core.simulation.frame_advance import advance_by_substeps
from egophys_core.simulation.substep import SubstepArrays, launch_substep


def advance_by_launches(batch: RolloutBatch) -> tuple[np.ndarray, tuple[str | None, ...]]:
    """Positions [K, F, N, 3], metres, and failures of a rollout with some launches a substep."""
    engine = Engine(batch, "cpu")
    out = (scratch(engine), scratch(engine))
    engine.advance = lambda state, substeps, inputs: advance_by_substeps(state, substeps, inputs, out)
    frames = [engine.node_positions().copy()]
    for frame in range(len(engine.times) - 1):
        engine.advance_frame(frame)
        frames.append(engine.node_positions().copy())
    return np.stack(frames, axis=1), tuple(engine.failures)


def scratch(engine: Engine) -> SubstepArrays:
    """What a substep of an engine writes."""
    return substep_arrays(engine.groups, engine.nodes, engine.controllers.shape[2], engine.memory, "cpu")


def forces_at_start(batch: RolloutBatch) -> np.ndarray:
    """[K, N, 3] newtons in the first substep."""
    return _forces(batch, [None])[0]


def forces_along(batch: RolloutBatch, places: np.ndarray) -> np.ndarray:
    """[S, N, 3] newtons on the nodes of one rollout that are at places [S, N, 3] in one substep after the other."""
    return _forces(batch, list(places))[:, 0]


def _forces(batch: RolloutBatch, places: list[np.ndarray | None]) -> np.ndarray:
    """[S, K, N, 3] newtons in substeps with nodes at places [N, 3], where these are given."""
    ahead, engine = Engine(batch, "cpu"), Engine(batch, "cpu")
    ahead.advance_frame(0)
    inputs = engine.frame_inputs(np.zeros(batch.count, int), ahead.segments[0])
    found = []
    for index, place in enumerate(places):
        out = scratch(engine)
        if place is not None:
            positions = unpack(engine.state.positions.numpy(), batch.count).copy()
            positions[:, : engine.nodes] = place
            engine.state.positions.assign(pack(positions))
        # Only the first substep of all is one in which a rollout begins.
        launch_substep(min(index, 1), engine.state, inputs, out)
        if engine.state.memory.size:
            engine.state.memory.assign(out.after.memory)
        found.append(unpack(out.forces.numpy(), batch.count))
    return np.array(found)
