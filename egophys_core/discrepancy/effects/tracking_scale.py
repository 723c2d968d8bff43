"""Motions of the hands are recorded too large or too small."""

from dataclasses import replace
from typing import Any

from egophys_core.discrepancy.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.discrepancy.effects.hands import moved_since_hold


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Scales how far each hand moved since it took hold; where it took hold stays."""
    moved, grip = moved_since_hold(scene, memory)
    shift = (values["scale"] - 1.0) * moved
    return Load(grip_shift=shift), replace(grip, shift=shift)


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"scale": 1.03}]


EFFECT = Effect(
    name="tracking_scale",
    summary="the hands moved farther, or less far, than recorded",
    equation="c(t) = c_hold + scale (c_recorded(t) - c_hold)",
    source="Umeyama, IEEE Trans. Pattern Analysis and Machine Intelligence 13 (1991) 376: similarity of two records",
    parameters=(Parameter(name="scale", unit="1", low=0.5, high=2.0, step=0.03, null=1.0),),
    mimics=("grasp_slip", "gravity_scale", "tracking_rotation", "control_delay"),
    experiment="move the gripper alone between two marks whose distance is known, with a point tracked on it",
    starts=starts,
    load=load,
)
