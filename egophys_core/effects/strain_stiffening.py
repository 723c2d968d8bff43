"""Material that becomes stiffer the more it is stretched."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.traits import Need, Traits

LARGEST_RISE = 6.0
"""Secant stiffness gained at most, over that at rest: what a simulation can still afford."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """The tangent of the force law at the strain at the start of the frame: its slope, and where it is 0.

    With the secant instead, springs under load would swing from frame to frame once c e^2 is above 1.
    """
    strain = np.maximum(scene.strain, 0.0)
    rise = np.minimum(values["coefficient"] * strain**2, LARGEST_RISE)
    factor = 1.0 + 3.0 * rise
    return Load(stiffness_factor=factor, rest_shift=2.0 * rise * strain / factor * scene.rest_lengths), None


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"coefficient": 20.0}]


EFFECT = Effect(
    name="strain_stiffening",
    summary="springs that become stiffer the more they are stretched",
    equation="F = k l0 (e + coefficient e^3) for strain e > 0",
    source="Fung, Biomechanics: Mechanical Properties of Living Tissues (1993), ch. 7; the first odd term",
    parameters=(Parameter(name="coefficient", unit="1", low=0.0, high=500.0, step=20.0, null=0.0),),
    traits=Traits(
        confounders=("tension_compression_asymmetry", "anisotropy", "hysteresis", "plasticity"),
        experiment="stretch it slowly between two hands in equal steps and look whether later steps stretch it less",
        needs=frozenset({Need.SPRINGS}),
    ),
    starts=starts,
    load=load,
)
