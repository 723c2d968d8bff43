"""Air that a sheet carries with it when it moves along its normal."""

from dataclasses import replace

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.effects.effect import Body, Effect, Parameter, Surroundings, Values
from egophys_core.effects.traits import Measurement, Need, Traits


def adapt(values: Values, body: Body) -> Body:
    """The mass of the air, over that of the sheet, in addition."""
    return replace(body, added_mass=body.added_mass + values["ratio"])


def falls(values: Values) -> np.ndarray:
    """[5] glides along itself."""
    return np.array([0.0, 0.0, -GRAVITY, 0.0, values["ratio"]])


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"ratio": 0.2}]


EFFECT = Effect(
    name="added_mass",
    summary="air that a sheet carries along its normal: inertia without weight",
    equation="(m + r m n n^T) a = F",
    source="Lamb, Hydrodynamics (1932), sec. 71: a disc of radius a carries 8/3 rho a^3, r of the sheet's mass",
    parameters=(Parameter(name="ratio", unit="1", low=0.0, high=5.0, step=0.1, null=0.0),),
    traits=Traits(
        confounders=("gravity_scale", "constant_body_force", "quadratic_drag", "bending_damping"),
        experiment="hang it by two corners and swing it, then let it fall flat: both are slow; a smaller gravity is "
        "slow on its edge, too",
        needs=frozenset({Need.THIN}),
        measured_by=(Measurement.FREE_FALL,),
        same_in_every_motion=True,
    ),
    starts=starts,
    adapt=adapt,
    falls=falls,
)
