"""Two extra forces: a gust that grows and ends at some time, and a damped tether to the origin."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Effect, NodeForce
from egophys_core.effects.traits import Traits
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays
from egophys_core.simulation import BatchEffect, RolloutBatch
from tests.reference.simulator import ExtraForce


@wp.func
def add_gust(
    group: int,
    first: int,
    last: int,
    column: int,
    time: Lanes,
    dt: Lanes,
    state: StateArrays,
    parameters: ParameterArrays,
    numbers: wp.array2d(dtype=Lanes),
    forces: wp.array3d(dtype=Lanes),
):
    """m t (jx, jy, jz) on every node until some time; numbers: j m/s^3, time s."""
    blows = Lanes()
    for lane in range(LANES):
        blows[lane] = time[lane] * wp.step(time[lane] - numbers[group, column + 3][lane])
    masses = parameters.masses
    for node in range(first, last):
        for axis in range(3):
            acceleration = wp.cw_mul(blows, numbers[group, column + axis])
            forces[group, node, axis] += wp.cw_mul(masses[group, node], acceleration)


@wp.func
def add_tether(
    group: int,
    first: int,
    last: int,
    column: int,
    time: Lanes,
    dt: Lanes,
    state: StateArrays,
    parameters: ParameterArrays,
    numbers: wp.array2d(dtype=Lanes),
    forces: wp.array3d(dtype=Lanes),
):
    """-k x - c v on every node; numbers: k N/m, c N s/m."""
    positions = state.positions
    velocities = state.velocities
    stiffness = numbers[group, column]
    damping = numbers[group, column + 1]
    for node in range(first, last):
        for axis in range(3):
            pull = wp.cw_mul(stiffness, positions[group, node, axis])
            forces[group, node, axis] -= pull + wp.cw_mul(damping, velocities[group, node, axis])


def toy(name: str, function: wp.Function) -> Effect:
    """An effect that is nothing but a force."""
    return Effect(
        name=name,
        summary="a toy",
        equation="F = f",
        source="none",
        parameters=(),
        traits=Traits(confounders=(), experiment="none"),
        starts=lambda surroundings: [],
        node_force=NodeForce(function=function, numbers=lambda values, body: np.zeros(0)),
    )


GUST, TETHER = toy("toy gust", add_gust), toy("toy tether", add_tether)


def gust_and_tether(gusts: np.ndarray, tethers: np.ndarray) -> tuple[BatchEffect, BatchEffect]:
    """Both, with numbers [K, 4] and [K, 2]."""
    return of_toy(GUST, gusts), of_toy(TETHER, tethers)


def of_toy(effect: Effect, numbers: np.ndarray) -> BatchEffect:
    """An effect that all rollouts have, with numbers [K, P]."""
    return BatchEffect(effect=effect, numbers=np.asarray(numbers, np.float32), present=np.ones(len(numbers), bool))


def extra_force(batch: RolloutBatch, row: int) -> ExtraForce | None:
    """The same forces for the reference simulator, with the numbers of one rollout of the batch."""
    if not batch.effects:
        return None
    gust, tether = (effect.numbers[row].astype(np.float64) for effect in batch.effects)
    masses = batch.masses[row].astype(np.float64)[:, None]
    return lambda time, dt, x, v: masses * time * gust[:3] * (time < gust[3]) - tether[0] * x - tether[1] * v
