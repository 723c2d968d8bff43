"""Air that resists with the square of the speed."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.traits import Traits


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Drag rate c |v| of each node, 1/s."""
    return Load(drag=values["coefficient"] * np.linalg.norm(scene.velocities, axis=1)), None


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"coefficient": 2.0}]


EFFECT = Effect(
    name="quadratic_drag",
    summary="air drag that grows with the square of the speed",
    equation="a = -c |v| v",
    source="Batchelor, An Introduction to Fluid Dynamics (1967), sec. 5.11; c = rho C_d A / (2 m)",
    parameters=(Parameter(name="coefficient", unit="1/m", low=0.0, high=60.0, step=2.0, null=0.0),),
    traits=Traits(
        confounders=("bending_damping", "viscoelasticity", "control_delay"),
        experiment="hold it by one corner and swing it at two speeds in still air: drag is fourfold at twice the speed",
        same_in_every_motion=True,
    ),
    starts=starts,
    load=load,
)
