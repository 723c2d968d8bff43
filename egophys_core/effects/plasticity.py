"""Material that stays deformed when it was strained too far."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.traits import Need, Traits

LARGEST_SET = 0.8
"""Share of its length that a spring can lose or gain for good."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """Rest lengths flow by the strain above the yield strain.

    At the start of a frame they take up what flowed in the last one; in the frame springs are elastic. So flow only
    ever takes energy (a return map, Simo and Hughes, sec. 1.7).
    """
    lasting = np.zeros(len(scene.springs)) if memory is None else memory
    elastic = scene.strain - lasting
    excess = elastic - np.clip(elastic, -values["yield_strain"], values["yield_strain"])
    flowed = lasting + excess * (1.0 - np.exp(-values["flow"] * scene.duration))
    lasting = np.clip(flowed, -LARGEST_SET, LARGEST_SET)
    return Load(rest_shift=lasting * scene.rest_lengths), lasting


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Material that yields early, or late."""
    return [{"flow": 1.0, "yield_strain": strain} for strain in (0.02, 0.05, 0.1)]


EFFECT = Effect(
    name="plasticity",
    summary="springs that stay longer, or shorter, after they were strained beyond a limit",
    equation="dp/dt = flow (|e - p| - yield_strain) sign(e - p) beyond the yield strain, F = k l0 (e - p)",
    source="Simo and Hughes, Computational Inelasticity (1998), ch. 1: one-dimensional viscoplasticity",
    parameters=(
        Parameter(name="flow", unit="1/s", low=0.0, high=30.0, step=1.0, null=0.0),
        Parameter(name="yield_strain", unit="1", low=0.002, high=0.5, step=0.3, logarithmic=True),
    ),
    traits=Traits(
        confounders=("viscoelasticity", "hysteresis", "grasp_slip"),
        experiment="stretch or fold it, lay it down, wait for five seconds and compare its shape with that before",
        needs=frozenset({Need.SPRINGS}),
    ),
    starts=starts,
    load=load,
)
