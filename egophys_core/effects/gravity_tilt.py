"""The world's z axis is not upright."""

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.rotations import rotation
from egophys_core.effects.traits import Measurement, Traits
from egophys_core.effects.uniform_force import add_uniform_force


def plumb(values: Values) -> np.ndarray:
    """The turned direction of gravity."""
    return np.asarray(-rotation(np.array([values["about_x"], values["about_y"], 0.0]))[:, 2])


def falls(values: Values) -> np.ndarray:
    """[5] falls along the plumb line."""
    return np.array([*(GRAVITY * plumb(values)), 0.0, 0.0])


def numbers(values: Values, body: Body) -> np.ndarray:
    """[3] m/s^2: what turning gravity adds to it."""
    return np.asarray(body.gravity * (plumb(values) + [0.0, 0.0, 1.0]))


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"about_x": 0.03, "about_y": 0.03}]


EFFECT = Effect(
    name="gravity_tilt",
    summary="gravity does not point along the world's -z: the world frame, or the table, is tilted",
    equation="a = -g R(about_x, about_y, 0) z",
    source="Titterton and Weston, Strapdown Inertial Navigation Technology (2004), ch. 10: levelling error",
    parameters=tuple(
        Parameter(name=name, unit="rad", low=-0.5, high=0.5, step=0.03, null=0.0) for name in ("about_x", "about_y")
    ),
    traits=Traits(
        confounders=("constant_body_force", "tracking_rotation", "tracking_offset"),
        experiment="let it slide or roll on the table with no hand near: tilt pulls it downhill, a turned "
        "record does not",
        measured_by=(Measurement.PLUMB_LINE, Measurement.FREE_FALL),
        same_in_every_motion=True,
        equivalent_to=("constant_body_force",),
        is_horizontal=lambda values: True,
        equivalent_in_air=("tracking_rotation",),
    ),
    starts=starts,
    plumb=plumb,
    falls=falls,
    node_force=NodeForce(function=add_uniform_force, numbers=numbers),
)
