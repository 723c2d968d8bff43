"""The object slides through the hand."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.hands import holding
from egophys_core.effects.timing import LATEST, share_of_frame
from egophys_core.effects.traits import Measurement, Need, Traits

FARTHEST = 0.3
"""Metres: beyond it nothing is left in the hand."""

ONSETS = 8
"""Times at which the search for a slip starts: a refit moves an onset by some tenths of a second."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Moves what is held through the hand, from the onset on for as long as it holds."""
    before = np.zeros(scene.controllers.shape) if memory is None else memory
    velocity = np.array([values["x"], values["y"], values["z"]])
    way = scene.duration * share_of_frame(scene, values["onset"], np.inf)
    shift = np.where(holding(scene)[:, None], before + way * velocity, 0.0)
    length = np.linalg.norm(shift, axis=1)[:, None]
    shift *= np.minimum(1.0, FARTHEST / np.maximum(length, FARTHEST))
    return Load(grip_shift=shift), shift


def held_displacement(values: Values, times: np.ndarray) -> np.ndarray:
    """How far what is held all the time has slid, [F, 3] metres."""
    velocity = np.array([values["x"], values["y"], values["z"]])
    return np.asarray(np.maximum(times - values["onset"], 0.0)[:, None] * velocity)


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
        held_displacement=held_displacement,
        is_event=True,
    ),
    starts=starts,
    load=load,
)
