"""The object slides through the hand."""

from typing import Any

import numpy as np

from egophys_core.discrepancy.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.discrepancy.effects.hands import hand_centres, holding
from egophys_core.discrepancy.effects.timing import LATEST, share_of_frame

FARTHEST = 0.3
"""Metres: beyond it nothing is left in the hand."""

ONSETS = 8
"""Times at which the search for a slip starts: a refit moves an onset by some tenths of a second."""

CENTRED = 1e-3
"""Metres: a hand nearer to the centre of mass has no direction towards it, and the object slides down."""

DOWN = np.array([0.0, 0.0, -1.0])


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Moves what is held from the hand towards the object's centre of mass, the way the object pulls."""
    holds = holding(scene)
    before = np.zeros(scene.controllers.shape) if memory is None else memory
    if not holds.any():
        return Load(), np.zeros_like(before)
    centre = scene.masses @ scene.positions / scene.masses.sum()
    towards = centre - hand_centres(scene, holds)
    distance = np.linalg.norm(towards, axis=1)[:, None]
    direction = np.where(distance > CENTRED, towards / np.maximum(distance, CENTRED), DOWN)
    way = values["rate"] * scene.duration * share_of_frame(scene, values["onset"], np.inf)
    shift = np.where(holds[:, None], before + way * direction, 0.0)
    length = np.linalg.norm(shift, axis=1)[:, None]
    shift *= np.minimum(1.0, FARTHEST / np.maximum(length, FARTHEST))
    return Load(grip_shift=shift), shift


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Slip from the first contact on, or from later."""
    begins, end = surroundings.contact_begins, surroundings.end
    return [{"rate": 0.01, "onset": float(onset)} for onset in np.linspace(begins, end, ONSETS, endpoint=False)]


EFFECT = Effect(
    name="grasp_slip",
    summary="the object slides through the hand from some time on",
    equation="hold(t) = hand(t) + rate (t - onset) n for t > onset, n from the hand to the centre of mass",
    source="Howe and Cutkosky, Int. J. Robotics Research 15(6) (1996) 557: sliding manipulation",
    parameters=(
        Parameter(name="rate", unit="m/s", low=0.0, high=0.2, step=0.01, null=0.0),
        Parameter(name="onset", unit="s", low=0.0, high=LATEST, step=0.2),
    ),
    mimics=("tracking_scale", "control_delay", "plasticity", "viscoelasticity", "time_varying_body_force"),
    experiment="lift it, hold still for five seconds and go back: the mark under the finger has moved on the object",
    starts=starts,
    load=load,
)
