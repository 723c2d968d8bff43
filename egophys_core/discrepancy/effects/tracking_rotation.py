"""Motions of the hands are recorded in a turned frame."""

from dataclasses import replace
from typing import Any

import numpy as np

from egophys_core.discrepancy.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.discrepancy.effects.hands import moved_since_hold
from egophys_core.discrepancy.effects.rotations import rotation


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Turns how each hand moved since it took hold; where it took hold stays."""
    moved, grip = moved_since_hold(scene, memory)
    turned = rotation(np.array([values["x"], values["y"], values["z"]])) - np.eye(3)
    shift = moved @ turned.T
    return Load(grip_shift=shift), replace(grip, shift=shift)


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"x": 0.03, "y": 0.03, "z": 0.03}]


EFFECT = Effect(
    name="tracking_rotation",
    summary="the hands moved in another direction than recorded: their frame is turned against the object's",
    equation="c(t) = c_hold + R(x, y, z) (c_recorded(t) - c_hold)",
    source="Horn, J. Optical Society of America A 4 (1987) 629: absolute orientation of two records",
    parameters=tuple(
        Parameter(name=axis, unit="rad", low=-0.5, high=0.5, step=0.03, null=0.0) for axis in ("x", "y", "z")
    ),
    mimics=("gravity_tilt", "tracking_scale", "tracking_offset", "constant_body_force"),
    experiment="move the gripper alone along each axis, with a point tracked on it, and compare the directions",
    starts=starts,
    load=load,
)
