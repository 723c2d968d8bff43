"""A thread that ties a place of the object to an anchor, at the height where that place lay at rest."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.places import CORNERS, longest_axes, spread, weights_around
from egophys_core.effects.traits import Traits
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays

PATCH_RADIUS = 0.01
"""Metres: the thread holds the nodes within about twice this."""


SHORTEST = 1e-9
"""Metres: guards the division by the distance at the anchor."""

FIRST_WEIGHT = 6
"""Column of the weight of the first node, after stiffness, length, anchor and the bound of the stiffness rate."""


@wp.func
def place_held(group: int, column: int, nodes: int, state: StateArrays, numbers: wp.array2d(dtype=Lanes)):
    """Where the thread is tied to the object now, metres.

    A function of its own: Warp's adjoint of a function knows no sum over a loop once the loop is over.
    """
    x = Lanes()
    y = Lanes()
    z = Lanes()
    for node in range(nodes):
        weight = numbers[group, column + FIRST_WEIGHT + node]
        x += wp.cw_mul(weight, state.positions[group, node, 0])
        y += wp.cw_mul(weight, state.positions[group, node, 1])
        z += wp.cw_mul(weight, state.positions[group, node, 2])
    return x, y, z


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
    """Add the pull of the thread to the nodes that it holds, by their weights, N.

    Numbers: M stiffness, N/m; length, m; anchor, m; a bound; and the weights, of sum 1, by which nodes are held.
    """
    strength = numbers[group, column]
    held_x, held_y, held_z = place_held(group, column, parameters.masses.shape[1], state, numbers)
    x = numbers[group, column + 2] - held_x
    y = numbers[group, column + 3] - held_y
    z = numbers[group, column + 4] - held_z
    squared = wp.cw_mul(x, x) + wp.cw_mul(y, y) + wp.cw_mul(z, z)
    length = numbers[group, column + 1]
    pull = Lanes()
    for lane in range(LANES):
        distance = wp.sqrt(wp.max(squared[lane], SHORTEST * SHORTEST))
        # A slack thread does not pull.
        pull[lane] = strength[lane] * wp.max(distance - length[lane], 0.0) / distance
    fx = wp.cw_mul(pull, x)
    fy = wp.cw_mul(pull, y)
    fz = wp.cw_mul(pull, z)
    for node in range(first, last):
        weight = numbers[group, column + FIRST_WEIGHT + node]
        forces[group, node, 0] += wp.cw_mul(weight, fx)
        forces[group, node, 1] += wp.cw_mul(weight, fy)
        forces[group, node, 2] += wp.cw_mul(weight, fz)


def numbers(values: Values, body: Body) -> np.ndarray:
    """[6 + N] what `add_tether` reads."""
    place = np.array([values["x"], values["y"], values["z"]])
    weights = weights_around(body.rest_positions, place, PATCH_RADIUS)
    anchor = weights @ body.positions + (values["anchor_x"], values["anchor_y"], 0.0)
    strength = body.masses.sum() * values["stiffness"]
    bound = strength * float((weights**2 / body.masses).sum())
    return np.array([strength, values["length"], *anchor, bound, *weights])


def stiffness_rate(numbers: np.ndarray) -> np.ndarray:
    """[K] 1/s^2: the largest eigenvalue of the thread alone, taut."""
    return numbers[:, FIRST_WEIGHT - 1]


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Tied at the middle or a corner of the object to where that lay, or at the middle to a place beside it.

    A thread does not pull at rest: it is as long as it is far to the anchor.
    """
    low, high = surroundings.rest_positions.min(axis=0), surroundings.rest_positions.max(axis=0)
    thread = {"stiffness": 2.0, "length": 0.02}
    snags = [
        {"x": float(x), "y": float(y), "z": float(z), "anchor_x": 0.0, "anchor_y": 0.0, **thread}
        for x, y, z in spread(low, high, CORNERS, extent_share=0.9, axes=longest_axes(high - low))
    ]
    beside = 0.5 * float((high - low).max())
    anchors = [(sign * beside * (axis == 0), sign * beside * (axis == 1)) for axis in (0, 1) for sign in (-1, 1)]
    return [*snags, *({**snags[0], "anchor_x": x, "anchor_y": y, "length": beside} for x, y in anchors)]


EFFECT = Effect(
    name="hidden_tether",
    summary="a thread, or a snag, that ties a place of the object to where that place lay at rest, or beside that",
    equation="F / M = stiffness max(|d| - length, 0) d / |d|, d = place at rest + anchor - place now",
    source="Antman, Nonlinear Problems of Elasticity (2005), ch. 3: strings pull and do not push",
    parameters=(
        *(Parameter(name=axis, unit="m", low=-3.0, high=3.0, step=0.03) for axis in ("x", "y", "z")),
        *(Parameter(name=f"anchor_{axis}", unit="m", low=-1.0, high=1.0, step=0.03) for axis in ("x", "y")),
        Parameter(name="stiffness", unit="1/s^2", low=0.0, high=100.0, step=2.0, null=0.0),
        Parameter(name="length", unit="m", low=0.0, high=1.0, step=0.02),
    ),
    traits=Traits(
        confounders=(
            "point_attraction",
            "place_dependent_friction",
            "table_adhesion",
            "uneven_mass",
            "constant_body_force",
        ),
        experiment="put it down somewhere else and repeat the motion: a snag stays behind, an added mass comes along",
    ),
    starts=starts,
    node_force=NodeForce(function=add_tether, numbers=numbers, stiffness_rate=stiffness_rate),
)
