"""The object's points are stamped later than those of the hands."""

import numpy as np

from egophys_core.discrepancy.effects.effect import Effect, Parameter, Surroundings, Values


def drive(values: Values, times: np.ndarray, controllers: np.ndarray) -> np.ndarray:
    """The hands as they were `delay` seconds before each time; held at the ends of the record."""
    earlier = np.clip(times - values["delay"], times[0], times[-1])
    after = np.clip(np.searchsorted(times, earlier, side="right"), 1, len(times) - 1)
    share = ((earlier - times[after - 1]) / (times[after] - times[after - 1]))[:, None, None]
    return (1.0 - share) * controllers[after - 1] + share * controllers[after]


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"delay": 0.02}]


EFFECT = Effect(
    name="control_delay",
    summary="the record of the hands runs ahead of the record of the object",
    equation="c(t) = c_recorded(t - d)",
    source="Ljung, System Identification (1999), sec. 3.2: input delay",
    parameters=(Parameter(name="delay", unit="s", low=-0.2, high=0.2, step=0.02, null=0.0),),
    mimics=("quadratic_drag", "viscoelasticity", "grasp_slip"),
    experiment="move the gripper alone, with a point tracked on it, and correlate its track with the record",
    starts=starts,
    drive=drive,
)
