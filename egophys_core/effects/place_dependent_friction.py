"""A patch of the table that is rougher or smoother than the rest."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.places import CORNERS, HORIZONTAL, spread
from egophys_core.effects.table_friction import bearing, pressed
from egophys_core.effects.traits import Need, Traits

EDGE = 0.25
"""Share of the radius over which the patch begins."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """What presses nodes in the patch onto the table, m/s^2."""
    borne = bearing(scene) if memory is None else memory
    offset = scene.positions[:, :2] - (values["x"], values["y"])
    outside = np.sqrt(np.einsum("ij,ij->i", offset, offset)) / values["radius"] - 1.0
    inside = np.clip(0.5 - outside / EDGE, 0.0, 1.0)
    return Load(acceleration=pressed(scene, values["change"] * inside, borne)), borne


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """The middle and the quarters of where the object was seen."""
    low, high = surroundings.low, surroundings.high
    radius = float(np.clip(0.3 * (high - low)[:2].max(), 0.02, 1.0))
    return [
        {"x": float(x), "y": float(y), "radius": radius, "change": 0.2}
        for x, y, _ in spread(low, high, CORNERS, reach=0.5, axes=HORIZONTAL)
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
    load=load,
)
