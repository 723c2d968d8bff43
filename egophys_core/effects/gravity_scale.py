"""Gravity that is stronger or weaker than assumed."""

from dataclasses import replace

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.effects.effect import Body, Effect, Parameter, Surroundings, Values
from egophys_core.effects.traits import Measurement, Traits


def adapt(values: Values, body: Body) -> Body:
    """Gravity times the scale."""
    return replace(body, gravity=body.gravity * values["scale"])


def falls(values: Values) -> np.ndarray:
    """[5] falls faster or more slowly."""
    return np.array([0.0, 0.0, -GRAVITY * values["scale"], 0.0, 0.0])


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"scale": 1.05}]


EFFECT = Effect(
    name="gravity_scale",
    summary="weight that is larger or smaller than the mass says: buoyancy, or lengths measured at a wrong scale",
    equation="a = -scale g z",
    source="Landau and Lifshitz, Fluid Mechanics (1987), sec. 3: buoyancy takes the share of the densities",
    parameters=(Parameter(name="scale", unit="1", low=0.3, high=2.0, step=0.05, null=1.0),),
    traits=Traits(
        confounders=("constant_body_force", "tracking_scale", "uneven_mass", "added_mass"),
        experiment="let go of it above the table and time the fall; then let it hang still and look how far "
        "it stretches",
        measured_by=(Measurement.FREE_FALL,),
        same_in_every_motion=True,
        is_vertical=lambda values: True,
    ),
    starts=starts,
    adapt=adapt,
    falls=falls,
)
