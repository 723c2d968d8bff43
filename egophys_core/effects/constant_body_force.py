"""A steady force on all of the object: wind, or a field."""

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.traits import Measurement, Traits
from egophys_core.effects.uniform_force import add_uniform_force


def numbers(values: Values, body: Body) -> np.ndarray:
    """[3] m/s^2."""
    return np.array([values["x"], values["y"], values["z"]])


def falls(values: Values) -> np.ndarray:
    """[5] falls aslant."""
    return np.array([values["x"], values["y"], values["z"] - GRAVITY, 0.0, 0.0])


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"x": 0.3, "y": 0.3, "z": 0.3}]


def is_horizontal(values: Values) -> bool:
    """Whether it points more to the side than up or down."""
    return bool(np.hypot(values["x"], values["y"]) > abs(values["z"]))


def is_vertical(values: Values) -> bool:
    """Whether it points more up or down than to the side."""
    return bool(abs(values["z"]) > np.hypot(values["x"], values["y"]))


EFFECT = Effect(
    name="constant_body_force",
    summary="a steady force on every part of the object, the same everywhere",
    equation="a = (x, y, z)",
    source="Landau and Lifshitz, Mechanics (1976), sec. 5: a uniform field",
    parameters=tuple(
        Parameter(name=axis, unit="m/s^2", low=-6.0, high=6.0, step=0.3, null=0.0) for axis in ("x", "y", "z")
    ),
    traits=Traits(
        confounders=(
            "gravity_tilt",
            "gravity_scale",
            "added_mass",
            "tracking_offset",
            "point_attraction",
            "hidden_tether",
        ),
        experiment="let it hang still from one corner, then turn the whole set-up by 90 degrees: a tilt turns with it",
        measured_by=(Measurement.FREE_FALL,),
        same_in_every_motion=True,
        special_cases=("gravity_tilt", "gravity_scale"),
        equivalent_to=("gravity_tilt",),
        is_horizontal=is_horizontal,
        is_vertical=is_vertical,
    ),
    starts=starts,
    falls=falls,
    node_force=NodeForce(function=add_uniform_force, numbers=numbers),
)
