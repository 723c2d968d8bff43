"""A point in the room that attracts the object, or repels it."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.places import CORNERS, HORIZONTAL, spread
from egophys_core.effects.traits import Traits

SEARCH_RANGES = (0.25, 0.5)
"""Ranges at the starts, over the larger horizontal size of the region in which the object was seen."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Acceleration towards the point, m/s^2: largest at the distance `range`, 0 at the point and far away."""
    offset = np.array([values["x"], values["y"], values["z"]]) - scene.positions
    offset /= values["range"]
    squared = np.einsum("ij,ij->i", offset, offset)
    offset *= (values["strength"] * np.exp(0.5 - 0.5 * squared))[:, None]
    return Load(acceleration=offset), None


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """The middle and the corners of where the object was seen, at half its height."""
    low, high = surroundings.low, surroundings.high
    size = float((high - low)[:2].max())
    return [
        {"x": float(x), "y": float(y), "z": float(z), "strength": 0.5, "range": float(np.clip(share * size, 0.02, 1.0))}
        for share in SEARCH_RANGES
        for x, y, z in spread(low, high, CORNERS, reach=0.8, axes=HORIZONTAL)
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
    load=load,
)
