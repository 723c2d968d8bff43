"""Friction that is larger at rest than when sliding."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.table_friction import bearing, press
from egophys_core.effects.traits import Need, Traits
from egophys_core.lanes import Lanes
from egophys_core.lanes.exponential import falling
from egophys_core.lanes.state import ParameterArrays, StateArrays


@wp.func
def add_stiction(
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
    """Add what presses slow nodes onto the table, N; numbers: rise times bearing; 1 / speed^2, s^2/m^2."""
    rise = numbers[group, column]
    for node in range(first, last):
        vx = state.velocities[group, node, 0]
        vy = state.velocities[group, node, 1]
        squared = wp.cw_mul(vx, vx) + wp.cw_mul(vy, vy)
        change = wp.cw_mul(rise, falling(wp.cw_mul(numbers[group, column + 1], squared)))
        press(group, node, change, state, parameters, forces)


def numbers(values: Values, body: Body) -> np.ndarray:
    """[2] what `add_stiction` reads."""
    return np.array([values["rise"] * bearing(body), values["speed"] ** -2])


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Friction that falls within slow creeping, and within the usual speed of a hand."""
    return [{"rise": 0.2, "speed": speed} for speed in (0.03, 0.15)]


EFFECT = Effect(
    name="stribeck_friction",
    summary="friction that is larger at rest and falls as sliding begins",
    equation="mu(v) = mu (1 + rise exp(-(v / speed)^2))",
    source="Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083",
    parameters=(
        Parameter(name="rise", unit="1", low=0.0, high=3.0, step=0.2, null=0.0),
        Parameter(name="speed", unit="m/s", low=0.005, high=1.0, step=0.3, logarithmic=True),
    ),
    traits=Traits(
        confounders=("place_dependent_friction", "table_adhesion", "grasp_slip"),
        experiment="drag it over the table at 1 cm/s and at 20 cm/s: with Coulomb friction both look alike",
        needs=frozenset({Need.TABLE}),
    ),
    starts=starts,
    node_force=NodeForce(function=add_stiction, numbers=numbers),
)
