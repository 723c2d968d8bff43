"""The terms of a generic force law, as an effect that a model carries while they are probed."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.table_friction import on_table
from egophys_core.effects.traits import Traits
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays

LINEAR, QUADRATIC, SLIDING, STRETCH = 3, 4, 5, 6
"""Columns after the uniform acceleration."""

LEAST_SLIDING = 0.03
"""m/s: below it the force of sliding fades."""

SMALLEST_SPEED = 1e-9
"""m/s: guards the slope of the speed at rest."""


@wp.func
def add_terms(
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
    """Add m times the sum of all terms, N; numbers: their coefficients."""
    nodes = parameters.masses.shape[1]
    for axis in range(3):
        total = Lanes()
        for node in range(nodes):
            total += state.positions[group, node, axis]
        mean = total / float(nodes)
        for node in range(first, last):
            away = state.positions[group, node, axis] - mean
            acceleration = numbers[group, column + axis] + wp.cw_mul(numbers[group, column + STRETCH + axis], away)
            forces[group, node, axis] += wp.cw_mul(parameters.masses[group, node], acceleration)
    for node in range(first, last):
        mass = parameters.masses[group, node]
        vx = state.velocities[group, node, 0]
        vy = state.velocities[group, node, 1]
        vz = state.velocities[group, node, 2]
        flat = wp.cw_mul(vx, vx) + wp.cw_mul(vy, vy)
        squared = flat + wp.cw_mul(vz, vz)
        lies = on_table(state.positions[group, node, 2] - parameters.contact_height[group])
        along = Lanes()
        sliding = Lanes()
        for lane in range(LANES):
            speed = wp.sqrt(wp.max(squared[lane], SMALLEST_SPEED * SMALLEST_SPEED))
            along[lane] = numbers[group, column + LINEAR][lane] + numbers[group, column + QUADRATIC][lane] * speed
            slides = wp.sqrt(wp.max(flat[lane], LEAST_SLIDING * LEAST_SLIDING))
            sliding[lane] = numbers[group, column + SLIDING][lane] * lies[lane] / slides
        on_plane = wp.cw_mul(mass, along - sliding)
        forces[group, node, 0] += wp.cw_mul(on_plane, vx)
        forces[group, node, 1] += wp.cw_mul(on_plane, vy)
        forces[group, node, 2] += wp.cw_mul(wp.cw_mul(mass, along), vz)


def numbers(values: Values, body: Body) -> np.ndarray:
    """[9] the coefficients."""
    return np.array([values[each.name] for each in LAW_TERMS.parameters])


def no_starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """It is not searched for: `generic_law` chooses among its terms."""
    return []


LAW_TERMS = Effect(
    name="generic_law",
    summary="the terms of a generic force law",
    equation="a = (x, y, z) + linear v + quadratic |v| v - sliding v_xy / |v_xy| on the table + stretch (p - mean p)",
    source="Messenger and Bortz, Multiscale Modeling and Simulation 19 (2021) 1474: weak SINDy",
    parameters=tuple(
        Parameter(name=name, unit=unit, low=-np.inf, high=np.inf, step=1.0, null=0.0)
        for name, unit in (
            *((axis, "m/s^2") for axis in "xyz"),
            ("linear", "1/s"),
            ("quadratic", "1/m"),
            ("sliding", "m/s^2"),
            *((f"stretch_{axis}", "1/s^2") for axis in "xyz"),
        )
    ),
    traits=Traits(confounders=(), experiment="none: it says what form of law fits, not which effect it is"),
    starts=no_starts,
    node_force=NodeForce(function=add_terms, numbers=numbers),
)
