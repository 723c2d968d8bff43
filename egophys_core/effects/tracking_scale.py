"""The object is recorded too small or too large."""

from dataclasses import replace

import numpy as np

from egophys_core.effects.effect import Body, Effect, Parameter, Surroundings, Values
from egophys_core.effects.traits import Measurement, Need, Traits


def drive(values: Values, times: np.ndarray, controllers: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """The hands where they are in the record of the object: on its scale, from the same origin."""
    return values["scale"] * controllers


def adapt(values: Values, body: Body) -> Body:
    """What falls is recorded on that scale, too."""
    return replace(body, gravity=body.gravity * values["scale"])


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"scale": 1.03}]


EFFECT = Effect(
    name="tracking_scale",
    summary="the object is recorded smaller or larger than it is, about the origin, and the hands are not",
    equation="p_recorded = scale p",
    source="Umeyama, IEEE Trans. Pattern Analysis and Machine Intelligence 13 (1991) 376: similarity of two records",
    parameters=(Parameter(name="scale", unit="1", low=0.5, high=2.0, step=0.03, null=1.0),),
    traits=Traits(
        confounders=("grasp_slip", "gravity_scale", "tracking_rotation", "control_delay", "tracking_offset"),
        experiment="move the gripper alone between two marks whose distance is known, with a point tracked on it",
        needs=frozenset({Need.MOVING_GRIP}),
        measured_by=(Measurement.GRIPS,),
        same_in_every_motion=True,
    ),
    starts=starts,
    drive=drive,
    adapt=adapt,
)
