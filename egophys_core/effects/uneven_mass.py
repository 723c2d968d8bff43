"""Added mass: a part of the object is heavier than the rest.

Motion tells forces only per mass, so the total is a scale that a twin chooses; added mass is shifted to its place and
leaves the total as it is. Otherwise it would act as softer springs all over, and be taken for them.
"""

from dataclasses import replace

import numpy as np

from egophys_core.effects.effect import Body, Effect, Parameter, Surroundings, Values
from egophys_core.effects.places import weights_around
from egophys_core.effects.traits import Need, Traits
from egophys_core.geometry import thick_axes

EXTENT_SHARES = np.array([0.3, 0.6])
"""Of the distance from the middle to an end, where added mass is looked for. From the middle and from 0.6 alone refits
did not reach 0.85 of a sheet's mass that hung at 0.4 (docs/notes/discrepancy.md)."""

RADIUS_SHARES = np.array([0.2, 0.4])
"""Of that distance, how wide it is where the search starts. What is wide and heavy passes for what is narrow and light:
from 0.4 alone 2.4 of a sheet's mass was found for 0.85."""


def adapt(values: Values, body: Body) -> Body:
    """Nodes near the place get a larger share of the mass; gravity and inertia follow, springs stay as they are."""
    centre = (body.rest_positions.min(axis=0) + body.rest_positions.max(axis=0)) / 2
    place = centre + (values["x"], values["y"], values["z"])
    weights = weights_around(body.rest_positions, place, values["radius"])
    fraction, total = values["fraction"], body.masses.sum()
    return replace(body, masses=(body.masses + fraction * total * weights) / (1.0 + fraction))


def lies_beside(values: Values, rest_positions: np.ndarray) -> bool:
    """Whether it lies where nothing of the object, [N, 3] metres, is; across a thin object its place is not told."""
    half = np.ptp(rest_positions, axis=0) / 2.0
    place = np.array([values["x"], values["y"], values["z"]])
    return bool((abs(place) > half + values["radius"])[thick_axes(half)].any())


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """The middle of the object and places towards the ends of its thick axes, narrow and wide."""
    low, high = surroundings.rest_positions.min(axis=0), surroundings.rest_positions.max(axis=0)
    half = (high - low) / 2
    radii = np.clip(RADIUS_SHARES * half.max(), 0.005, 0.5)
    thick = np.flatnonzero(thick_axes(half))
    places = [
        np.zeros(3),
        *(
            sign * share * half[axis] * np.eye(3)[axis]
            for axis in thick
            for share in EXTENT_SHARES
            for sign in (-1.0, 1.0)
        ),
    ]
    return [
        {"x": float(x), "y": float(y), "z": float(z), "radius": float(radius), "fraction": 0.2}
        for radius in radii
        for x, y, z in places
    ]


EFFECT = Effect(
    name="uneven_mass",
    summary="added mass in the object: beyond an even share about one place",
    equation="m_i = (m + fraction M w_i) / (1 + fraction), w Gaussian of deviation radius, (x, y, z) from the centre",
    source="Atkeson, An and Hollerbach, Int. J. Robotics Research 5(3) (1986) 101: inertial parameters of loads",
    parameters=(
        *(Parameter(name=axis, unit="m", low=-1.0, high=1.0, step=0.03) for axis in ("x", "y", "z")),
        Parameter(name="radius", unit="m", low=0.005, high=0.5, step=0.3, logarithmic=True),
        Parameter(name="fraction", unit="1", low=0.0, high=6.0, step=0.1, null=0.0),
    ),
    traits=Traits(
        confounders=(
            "gravity_scale",
            "hidden_tether",
            "anisotropy",
            "constant_body_force",
            # What is held at one place turns about it: there its centre of mass is off, or the hand is.
            "gripper_offset",
            "tracking_offset",
        ),
        experiment="let it hang still from one end, then from the other: the added mass stretches what is above it; "
        "turned half round before it is grasped it carries the mass along, while an offset of hands stays",
        needs=frozenset({Need.FINE_NODES}),
        common_in=frozenset({"solid"}),
        is_implausible=lies_beside,
    ),
    starts=starts,
    adapt=adapt,
)
