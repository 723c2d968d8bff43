"""The object slides through the hand."""

import numpy as np

from egophys_core.effects.effect import Effect, Parameter, Surroundings, Values
from egophys_core.effects.timing import LATEST
from egophys_core.effects.traits import Measurement, Need, Traits

ONSETS = 8
"""Times at which the search for a slip starts: a refit moves an onset by some tenths of a second."""

FAINT_PULL = 0.05
"""Of the object's weight; what pulls less on a hand stays in it."""


def slide(values: Values, begins: np.ndarray, ends: np.ndarray, pulls: np.ndarray) -> np.ndarray:
    """What is held gives way along its pull, and to whatever side the fingers let it go."""
    seconds = np.maximum(ends - np.maximum(begins, values["onset"]), 0.0)[:, None, None]
    sizes = np.linalg.norm(pulls, axis=2, keepdims=True)
    along = pulls / np.where(sizes > FAINT_PULL, sizes, 1.0)
    velocities = -values["z"] * along + np.array([values["x"], values["y"], 0.0])
    return np.where(sizes > FAINT_PULL, seconds * velocities, 0.0)


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Slip mostly along the pull, from the first contact on, or from later."""
    begins, end = surroundings.contact_begins, surroundings.end
    onsets = np.linspace(begins, end, ONSETS, endpoint=False)
    return [{"x": 0.002, "y": 0.002, "z": -0.01, "onset": float(onset)} for onset in onsets]


EFFECT = Effect(
    name="grasp_slip",
    summary="the object slides through the hand from some time on",
    equation="hold'(t) = hand'(t) + (x, y, 0) - z p for t > onset where it is pulled along p: (x, y, z) where it hangs",
    source="Howe and Cutkosky, Int. J. Robotics Research 15(6) (1996) 557: sliding manipulation",
    parameters=(
        *(Parameter(name=axis, unit="m/s", low=-0.2, high=0.2, step=0.01, null=0.0) for axis in ("x", "y", "z")),
        Parameter(name="onset", unit="s", low=0.0, high=LATEST, step=0.2),
    ),
    traits=Traits(
        confounders=("tracking_scale", "control_delay", "plasticity", "viscoelasticity", "time_varying_body_force"),
        experiment="lift it, hold still for five seconds and go back: the mark under the finger has moved on "
        "the object",
        needs=frozenset({Need.MOVING_GRIP}),
        measured_by=(Measurement.GRIPS,),
        is_event=True,
    ),
    starts=starts,
    slide=slide,
)
