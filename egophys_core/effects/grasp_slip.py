"""The object slides through the hand."""

import numpy as np

from egophys_core.effects.effect import Effect, Parameter, Surroundings, Values
from egophys_core.effects.timing import LATEST
from egophys_core.effects.traits import Measurement, Need, Traits

FARTHEST = 0.3
"""Metres: beyond it nothing is left in the hand."""

ONSETS = 8
"""Times at which the search for a slip starts: a refit moves an onset by some tenths of a second."""


def drive(values: Values, times: np.ndarray, controllers: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """Moves what is held through the hand, from the onset on for as long as it holds.

    Where it was when the hand lets go it stays for a frame more, so that the hand's speed says nothing of its way back.
    """
    frames = np.arange(len(times))[:, None]
    slips = np.maximum(times - values["onset"], 0.0)
    # The end of the last frame of a hold belongs to it, and the frame after that as well.
    lasts = np.stack([np.pad(holds, ((by, 0), (0, 0)))[: len(times)] for by in (0, 1, 2)]).any(axis=0) & (frames > 0)
    begins = holds & ~np.pad(holds, ((1, 0), (0, 0)))[:-1]
    ends = np.pad(holds, ((1, 0), (0, 0)))[:-1] & ~holds
    since = np.maximum.accumulate(np.where(begins, frames, 0), axis=0)
    until = np.where(holds, frames, np.maximum.accumulate(np.where(ends, frames, 0), axis=0))
    seconds = np.where(lasts & ~begins, slips[until] - slips[since], 0.0)
    velocity = np.array([values["x"], values["y"], values["z"]])
    farthest = FARTHEST / max(float(np.linalg.norm(velocity)), 1e-9)
    return np.asarray(controllers + np.minimum(seconds, farthest)[..., None] * velocity)


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Slip mostly down, as what hangs pulls, from the first contact on, or from later."""
    begins, end = surroundings.contact_begins, surroundings.end
    onsets = np.linspace(begins, end, ONSETS, endpoint=False)
    return [{"x": 0.002, "y": 0.002, "z": -0.01, "onset": float(onset)} for onset in onsets]


EFFECT = Effect(
    name="grasp_slip",
    summary="the object slides through the hand from some time on",
    equation="hold(t) = hand(t) + (x, y, z) (t - onset) for t > onset",
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
        measured_by=Measurement.GRIPS,
        is_event=True,
    ),
    starts=starts,
    drive=drive,
)
