"""Material that is stiffer, or softer, when pressed than when pulled."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.traits import Need, Traits


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Another stiffness for springs that are shorter than at rest."""
    return Load(stiffness_factor=np.where(scene.strain < 0.0, 1.0 + values["change"], 1.0)), None


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"change": 0.2}]


EFFECT = Effect(
    name="tension_compression_asymmetry",
    summary="springs with another stiffness when pressed than when pulled",
    equation="F = k l0 e for strain e > 0, k (1 + change) l0 e for e < 0",
    source="Curnier, He and Zysset, J. Elasticity 37 (1995) 1: conewise linear elasticity",
    parameters=(Parameter(name="change", unit="1", low=-0.9, high=5.0, step=0.2, null=0.0),),
    traits=Traits(
        confounders=("strain_stiffening", "anisotropy", "bending_damping"),
        experiment="pull it between two hands, then push the hands together by as much",
        needs=frozenset({Need.SPRINGS}),
    ),
    starts=starts,
    load=load,
)
