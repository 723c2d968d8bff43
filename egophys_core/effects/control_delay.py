"""The object's points are stamped later than those of the hands."""

import numpy as np

from egophys_core.effects.effect import Effect, Parameter, Surroundings, Values
from egophys_core.effects.traits import Measurement, Need, Traits


def clock(values: Values, times: np.ndarray) -> np.ndarray:
    """Each time less the delay."""
    return times - values["delay"]


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"delay": 0.02}]


EFFECT = Effect(
    name="control_delay",
    summary="the record of the hands runs ahead of the record of the object",
    equation="c(t) = c_recorded(t - d)",
    source="Ljung, System Identification (1999), sec. 3.2: input delay",
    parameters=(Parameter(name="delay", unit="s", low=-1.0, high=1.0, step=0.02, null=0.0),),
    traits=Traits(
        confounders=("quadratic_drag", "viscoelasticity", "grasp_slip"),
        experiment="move the gripper alone, with a point tracked on it, and correlate its track with the record",
        needs=frozenset({Need.MOVING_GRIP}),
        measured_by=(Measurement.GRIPS,),
        same_in_every_motion=True,
    ),
    starts=starts,
    clock=clock,
)
