"""A patch of the table that is rougher or smoother than the rest."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.places import CORNERS, HORIZONTAL, spread
from egophys_core.effects.table_friction import bearing, press
from egophys_core.effects.traits import Need, Traits
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays

EDGE = 0.25
"""Share of the radius over which the patch begins."""


SMALLEST_DISTANCE = 1e-9
"""Metres: guards the slope of the distance in the middle of the patch."""


@wp.func
def add_patch(
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
    """Add what presses nodes in the patch onto the table, N; numbers: place, m; 1 / radius; change times bearing."""
    change = numbers[group, column + 3]
    for node in range(first, last):
        x = state.positions[group, node, 0] - numbers[group, column]
        y = state.positions[group, node, 1] - numbers[group, column + 1]
        squared = wp.cw_mul(x, x) + wp.cw_mul(y, y)
        inside = Lanes()
        for lane in range(LANES):
            distance = wp.sqrt(wp.max(squared[lane], SMALLEST_DISTANCE * SMALLEST_DISTANCE))
            outside = distance * numbers[group, column + 2][lane] - 1.0
            inside[lane] = wp.min(wp.max(0.5 - outside / EDGE, 0.0), 1.0)
        press(group, node, wp.cw_mul(change, inside), state, parameters, forces)


def numbers(values: Values, body: Body) -> np.ndarray:
    """[4] what `add_patch` reads."""
    return np.array([values["x"], values["y"], 1.0 / values["radius"], values["change"] * bearing(body)])


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """The middle and the quarters of where the object was seen."""
    low, high = surroundings.low, surroundings.high
    radius = float(np.clip(0.3 * (high - low)[:2].max(), 0.02, 1.0))
    return [
        {"x": float(x), "y": float(y), "radius": radius, "change": 0.2}
        for x, y, _ in spread(low, high, CORNERS, extent_share=0.5, axes=HORIZONTAL)
    ]


EFFECT = Effect(
    name="place_dependent_friction",
    summary="a round patch of the table where friction is another than elsewhere",
    equation="mu(p) = mu (1 + change) for |p - (x, y)| < radius, else mu",
    source="Popov, Contact Mechanics and Friction (2010), ch. 10: Coulomb friction depends on the pair of surfaces",
    parameters=(
        *(Parameter(name=axis, unit="m", low=-3.0, high=3.0, step=0.03) for axis in ("x", "y")),
        Parameter(name="radius", unit="m", low=0.02, high=1.0, step=0.2, logarithmic=True),
        Parameter(name="change", unit="1", low=-0.9, high=4.0, step=0.2, null=0.0),
    ),
    traits=Traits(
        confounders=("stribeck_friction", "table_adhesion", "hidden_tether", "point_attraction"),
        experiment="drag it over the table along the same path twice, the second time with the start moved by "
        "its own size",
        needs=frozenset({Need.TABLE}),
    ),
    starts=starts,
    node_force=NodeForce(function=add_patch, numbers=numbers),
)
