"""Central differences of the float64 reference simulator, to hold gradients against."""

from dataclasses import replace

import numpy as np

from egophys_core.simulation import RolloutBatch
from egophys_core.simulation.engine import Engine
from egophys_core.simulation.gradients import Gradient
from tests.reference.simulator import simulate
from tests.simulation.effect_terms import extra_force

STEPS = {
    "stiffness": 1e-3,
    "damping": 1e-5,
    "rest_lengths": 1e-6,
    "longest_extensions": 1e-6,
    "masses": 1e-6,
    "controller_stiffness": 1e-3,
    "controller_damping": 1e-5,
    "gravity": 1e-4,
    "drag": 1e-4,
    "added_mass": 1e-4,
    "compression_ratio": 1e-4,
    "restitution": 1e-5,
    "friction": 1e-5,
    "ground_projection": 1e-4,
    "contact_threshold": 1e-7,
    "collision_restitution": 1e-5,
    "collision_friction": 1e-5,
    "contact_height": 1e-7,
    "effects": 1e-4,
    "controls": 1e-6,
    "positions": 1e-6,
    "velocities": 1e-5,
}
"""By which inputs are changed, in their own units: so little that nothing hits the table a substep sooner or later."""


def linear_loss(weights: np.ndarray):
    """Loss of `differentiate`: the sum of weights [F, N, 3] times positions, for each rollout."""
    return lambda positions: (np.einsum("kfnx,fnx->k", positions, weights), np.broadcast_to(weights, positions.shape))


def derivative(gradient: Gradient, name: str, row: int) -> np.ndarray:
    """What `Gradient` says of one input of one rollout."""
    values = gradient.parameters[name] if name in gradient.parameters else getattr(gradient, name)
    return np.atleast_1d(values[row])


def changed(batch: RolloutBatch, name: str, row: int, index: tuple[int, ...], by: float) -> RolloutBatch:
    """The batch with one number of one rollout changed, in float64."""
    alpha, controls = batch.parameters[row], batch.controls[row]
    if name == "contact_height":
        return replace(batch, ground_height=batch.ground_height + by)
    if name == "controls":
        path = controls.positions.astype(np.float64)
        path[index] += by
        moved = replace(controls, positions=path)
        return replace(batch, controls=(*batch.controls[:row], moved, *batch.controls[row + 1 :]))
    if name == "effects":
        owner, column = divmod(index[0], batch.effects[0].numbers.shape[1])
        numbers = batch.effects[owner].numbers.astype(np.float64)
        numbers[row, column] += by
        effects = list(batch.effects)
        effects[owner] = replace(effects[owner], numbers=numbers)
        return replace(batch, effects=tuple(effects))
    if name in ("stiffness", "damping", "rest_lengths", "longest_extensions", "masses", "positions", "velocities"):
        values = getattr(batch, name).astype(np.float64)
        values[(row, *index)] += by
        return replace(batch, **{name: values})
    # Only the dashpot of controller springs is read from the parameters, others stand in the batch.
    field = "damping" if name == "controller_damping" else name
    other = replace(alpha, **{field: getattr(alpha, field) + by})
    return replace(batch, parameters=(*batch.parameters[:row], other, *batch.parameters[row + 1 :]))


def central_differences(
    batch: RolloutBatch, name: str, row: int, shape: tuple[int, ...], weights: np.ndarray, substeps: np.ndarray
) -> np.ndarray:
    """[*shape] derivatives of a `linear_loss` by one input of one rollout."""

    def loss(changed_batch: RolloutBatch) -> float:
        extra = extra_force(changed_batch, row)
        return float((weights * simulate(changed_batch, row, substeps=substeps, extra=extra)).sum())

    found = np.zeros(shape)
    step = STEPS[name]
    for index in np.ndindex(shape):
        up, down = (loss(changed(batch, name, row, index, by)) for by in (step, -step))
        found[index] = (up - down) / (2 * step)
    return found


def substeps_of(batch: RolloutBatch, row: int = 0) -> np.ndarray:
    """[F - 1] substeps of each frame of a rollout."""
    engine = Engine(batch, "cpu")
    for frame in range(len(engine.times) - 1):
        engine.advance_frame(frame)
    return np.array([segment.substeps[row] for segment in engine.segments])
