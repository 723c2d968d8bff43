"""Two extra forces: a gust that grows and ends at some time, and a damped tether to the origin."""

import numpy as np
import warp as wp

from egophys_core.simulation import ForceEffect, RolloutBatch
from egophys_core.simulation.lanes import LANES, Lanes
from egophys_core.simulation.state import ParameterArrays, StateArrays
from tests.reference.simulator import ExtraForce


@wp.func
def add_gust(
    group: int,
    first: int,
    last: int,
    column: int,
    time: Lanes,
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


def gust_and_tether(gusts: np.ndarray, tethers: np.ndarray) -> tuple[ForceEffect, ForceEffect]:
    """Both, with numbers [K, 4] and [K, 2]."""
    return (
        ForceEffect(add_forces=add_gust, numbers=np.asarray(gusts, np.float32)),
        ForceEffect(add_forces=add_tether, numbers=np.asarray(tethers, np.float32)),
    )


def extra_force(batch: RolloutBatch, row: int) -> ExtraForce | None:
    """The same forces for the reference simulator, with the numbers of one rollout of the batch."""
    if not batch.effects:
        return None
    gust, tether = (effect.numbers[row].astype(np.float64) for effect in batch.effects)
    masses = batch.masses[row].astype(np.float64)[:, None]
    return lambda time, x, v: masses * time * gust[:3] * (time < gust[3]) - tether[0] * x - tether[1] * v
