"""The table holds back what is lifted off it."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.traits import Need, Traits

SHORTEST_PATH = 1e-3
"""In units of the reach: nodes that move less in a frame feel the pull where they are."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Pull towards the table, m/s^2: its mean over the heights that a node passes in the frame."""
    begin = np.maximum(scene.positions[:, 2] - scene.contact_height, 0.0) / values["reach"]
    end = np.maximum(begin + scene.velocities[:, 2] * scene.duration / values["reach"], 0.0)
    path = end - begin
    moves = np.abs(path) > SHORTEST_PATH
    # u exp(1 - u) is the derivative of -(1 + u) exp(1 - u).
    work = (1.0 + begin) * np.exp(1.0 - begin) - (1.0 + end) * np.exp(1.0 - end)
    pull = np.where(moves, work / np.where(moves, path, 1.0), begin * np.exp(1.0 - begin))
    acceleration = np.zeros_like(scene.positions)
    acceleration[:, 2] = -values["strength"] * pull
    return Load(acceleration=acceleration), None


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """A short reach, as of a film of water, and a longer one, as of fibres."""
    return [{"strength": 1.0, "reach": reach} for reach in (0.008, 0.03)]


EFFECT = Effect(
    name="table_adhesion",
    summary="the table pulls back what is lifted off it: a sticky or wet top, static charge",
    equation="a_z = -strength u exp(1 - u), u = height / reach",
    source="Xu and Needleman, J. Mech. Phys. Solids 42 (1994) 1397: normal traction of a cohesive surface",
    parameters=(
        Parameter(name="strength", unit="m/s^2", low=0.0, high=30.0, step=1.0, null=0.0),
        Parameter(name="reach", unit="m", low=0.005, high=0.1, step=0.3, logarithmic=True),
    ),
    traits=Traits(
        confounders=("gravity_scale", "stribeck_friction", "hidden_tether", "uneven_mass"),
        experiment="peel it slowly off the table from one corner, then repeat it with another sheet laid under it",
        needs=frozenset({Need.TABLE}),
    ),
    starts=starts,
    load=load,
)
