"""The table holds back what is lifted off it."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.traits import Need, Traits
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.exponential import falling
from egophys_core.lanes.state import ParameterArrays, StateArrays


@wp.func
def add_adhesion(
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
    """Add -m strength u exp(1 - u), N, upward; numbers: strength e, m/s^2; 1 / reach, 1/m."""
    strength = numbers[group, column]
    inverse_reach = numbers[group, column + 1]
    height = parameters.contact_height[group]
    for node in range(first, last):
        above = Lanes()
        for lane in range(LANES):
            above[lane] = wp.max(state.positions[group, node, 2][lane] - height[lane], 0.0) * inverse_reach[lane]
        pull = wp.cw_mul(wp.cw_mul(strength, above), falling(above))
        forces[group, node, 2] -= wp.cw_mul(parameters.masses[group, node], pull)


def numbers(values: Values, body: Body) -> np.ndarray:
    """[2] what `add_adhesion` reads."""
    return np.array([values["strength"] * np.e, 1.0 / values["reach"]])


def stiffness_rate(numbers: np.ndarray) -> np.ndarray:
    """[K] 1/s^2: the steepest slope of the pull, on the table."""
    return numbers[:, 0] * numbers[:, 1]


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """A short reach, as of a film of water, and a longer one, as of fibres."""
    return [{"strength": 1.0, "reach": reach} for reach in (0.008, 0.03)]


EFFECT = Effect(
    name="table_adhesion",
    summary="the table pulls back what is lifted off it: a sticky or wet top, static charge",
    equation="a_z = -strength u exp(1 - u), u = height / reach",
    source="Xu and Needleman, J. Mech. Phys. Solids 42 (1994) 1397: normal traction of a cohesive surface",
    parameters=(
        Parameter(name="strength", unit="m/s^2", low=0.0, high=30.0, step=1.0, null=0.0),
        Parameter(name="reach", unit="m", low=0.005, high=0.1, step=0.3, logarithmic=True),
    ),
    traits=Traits(
        confounders=("gravity_scale", "stribeck_friction", "hidden_tether", "uneven_mass"),
        experiment="peel it slowly off the table from one corner, then repeat it with another sheet laid under it",
        needs=frozenset({Need.TABLE}),
    ),
    starts=starts,
    node_force=NodeForce(function=add_adhesion, numbers=numbers, stiffness_rate=stiffness_rate),
)
