"""Friction that is larger at rest than when sliding."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.table_friction import bearing, pressed
from egophys_core.effects.traits import Need, Traits


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """What presses slow nodes onto the table, m/s^2."""
    borne = bearing(scene) if memory is None else memory
    velocities = scene.velocities[:, :2]
    squared = np.einsum("ij,ij->i", velocities, velocities) / values["speed"] ** 2
    return Load(acceleration=pressed(scene, values["rise"] * np.exp(-squared), borne)), borne


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Friction that falls within slow creeping, and within the usual speed of a hand."""
    return [{"rise": 0.2, "speed": speed} for speed in (0.03, 0.15)]


EFFECT = Effect(
    name="stribeck_friction",
    summary="friction that is larger at rest and falls as sliding begins",
    equation="mu(v) = mu (1 + rise exp(-(v / speed)^2))",
    source="Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083",
    parameters=(
        Parameter(name="rise", unit="1", low=0.0, high=3.0, step=0.2, null=0.0),
        Parameter(name="speed", unit="m/s", low=0.005, high=1.0, step=0.3, logarithmic=True),
    ),
    traits=Traits(
        confounders=("place_dependent_friction", "table_adhesion", "grasp_slip"),
        experiment="drag it over the table at 1 cm/s and at 20 cm/s: with Coulomb friction both look alike",
        needs=frozenset({Need.TABLE}),
    ),
    starts=starts,
    load=load,
)
