"""A point in the room that attracts the object, or repels it."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.places import CORNERS, HORIZONTAL, spread
from egophys_core.effects.traits import Traits
from egophys_core.lanes import Lanes
from egophys_core.lanes.exponential import falling
from egophys_core.lanes.state import ParameterArrays, StateArrays

SEARCH_RANGES = (0.25, 0.5)
"""Ranges at the starts, over the larger horizontal size of the region in which the object was seen."""


@wp.func
def add_attraction(
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
    """Add m strength d / range exp((1 - |d|^2 / range^2) / 2), N; numbers: place, m; strength sqrt(e); 1 / range."""
    strength = numbers[group, column + 3]
    inverse_range = numbers[group, column + 4]
    for node in range(first, last):
        x = wp.cw_mul(inverse_range, numbers[group, column] - state.positions[group, node, 0])
        y = wp.cw_mul(inverse_range, numbers[group, column + 1] - state.positions[group, node, 1])
        z = wp.cw_mul(inverse_range, numbers[group, column + 2] - state.positions[group, node, 2])
        fading = falling(0.5 * (wp.cw_mul(x, x) + wp.cw_mul(y, y) + wp.cw_mul(z, z)))
        pull = wp.cw_mul(parameters.masses[group, node], wp.cw_mul(strength, fading))
        forces[group, node, 0] += wp.cw_mul(pull, x)
        forces[group, node, 1] += wp.cw_mul(pull, y)
        forces[group, node, 2] += wp.cw_mul(pull, z)


def numbers(values: Values, body: Body) -> np.ndarray:
    """[5] what `add_attraction` reads."""
    place = [values["x"], values["y"], values["z"]]
    return np.array([*place, values["strength"] * np.sqrt(np.e), 1.0 / values["range"]])


def stiffness_rate(numbers: np.ndarray) -> np.ndarray:
    """[K] 1/s^2: the steepest slope of the pull, at the point."""
    return np.abs(numbers[:, 3]) * numbers[:, 4]


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """The middle and the corners of where the object was seen, at half its height."""
    low, high = surroundings.low, surroundings.high
    size = float((high - low)[:2].max())
    return [
        {"x": float(x), "y": float(y), "z": float(z), "strength": 0.5, "range": float(np.clip(share * size, 0.02, 1.0))}
        for share in SEARCH_RANGES
        for x, y, z in spread(low, high, CORNERS, extent_share=0.8, axes=HORIZONTAL)
    ]


EFFECT = Effect(
    name="point_attraction",
    summary="a place in the room that attracts the object (strength > 0) or repels it: a magnet, a charge, a fan",
    equation="a = strength (d / range) exp((1 - |d|^2 / range^2) / 2), d = (x, y, z) - position",
    source="Landau and Lifshitz, Mechanics (1976), sec. 14: a central field; here one of finite range",
    parameters=(
        *(Parameter(name=axis, unit="m", low=-3.0, high=3.0, step=0.03) for axis in ("x", "y", "z")),
        Parameter(name="strength", unit="m/s^2", low=-15.0, high=15.0, step=0.5, null=0.0),
        Parameter(name="range", unit="m", low=0.02, high=1.0, step=0.2, logarithmic=True),
    ),
    traits=Traits(
        confounders=("constant_body_force", "hidden_tether", "gravity_tilt", "place_dependent_friction"),
        experiment="carry it slowly around the place at a constant distance: the pull keeps pointing at the place",
        same_in_every_motion=True,
        special_cases=("constant_body_force", "gravity_tilt", "gravity_scale"),
    ),
    starts=starts,
    node_force=NodeForce(function=add_attraction, numbers=numbers, stiffness_rate=stiffness_rate),
)
