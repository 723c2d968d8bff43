"""A lump: a part of the object is heavier than the rest."""

from dataclasses import replace

import numpy as np

from egophys_core.discrepancy.effects.effect import Body, Effect, Parameter, Surroundings, Values
from egophys_core.discrepancy.effects.places import CROSS, longest_axes, spread, weights_around


def adapt(values: Values, body: Body) -> Body:
    """Nodes near the place get mass; gravity and inertia follow, springs stay as they are."""
    centre = (body.rest_positions.min(axis=0) + body.rest_positions.max(axis=0)) / 2
    place = centre + (values["x"], values["y"], values["z"])
    weights = weights_around(body.rest_positions, place, values["radius"])
    return replace(body, masses=body.masses + values["fraction"] * body.masses.sum() * weights)


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """The middle of the object and four places towards its ends."""
    low, high = surroundings.rest_positions.min(axis=0), surroundings.rest_positions.max(axis=0)
    half = (high - low) / 2
    axes = longest_axes(half)
    radius = float(np.clip(0.2 * 2 * half[axes[0]], 0.005, 0.5))
    return [
        {"x": float(x), "y": float(y), "z": float(z), "radius": radius, "fraction": 0.1}
        for x, y, z in spread(-half, half, CROSS, reach=0.6, axes=axes)
    ]


EFFECT = Effect(
    name="uneven_mass",
    summary="a lump in the object: mass beyond an even share about one place",
    equation="m_i = m + fraction M w_i, w Gaussian of deviation radius about the box centre at rest + (x, y, z)",
    source="Atkeson, An and Hollerbach, Int. J. Robotics Research 5(3) (1986) 101: inertial parameters of loads",
    parameters=(
        *(Parameter(name=axis, unit="m", low=-1.0, high=1.0, step=0.03) for axis in ("x", "y", "z")),
        Parameter(name="radius", unit="m", low=0.005, high=0.5, step=0.3, logarithmic=True),
        Parameter(name="fraction", unit="1", low=0.0, high=3.0, step=0.1, null=0.0),
    ),
    mimics=("gravity_scale", "hidden_tether", "anisotropy", "constant_body_force"),
    experiment="let it hang still from one end, then from the other: the lump stretches what is above it",
    starts=starts,
    adapt=adapt,
)
