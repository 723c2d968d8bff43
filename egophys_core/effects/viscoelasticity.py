"""Material that relaxes: part of its force fades while it is kept stretched."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.traits import Measurement, Need, Traits


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """A Maxwell arm beside each spring: stiffness for both, and a rest length between theirs.

    The arm's dashpot follows the extension at the start of the frame exactly; it acts as it is in mid-frame.
    """
    extension = scene.strain * scene.rest_lengths
    arm = extension if memory is None else extension - memory
    half = np.exp(-0.5 * scene.duration / values["time"])
    ratio = values["ratio"]
    return (
        Load(
            stiffness_factor=np.full(len(extension), 1.0 + ratio),
            rest_shift=ratio / (1.0 + ratio) * (extension - half * arm),
        ),
        extension - half**2 * arm,
    )


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Relaxation within a swing, within a lift and over the episode."""
    return [{"ratio": 0.2, "time": time} for time in (0.1, 0.4, 1.5)]


EFFECT = Effect(
    name="viscoelasticity",
    summary="springs that relax: stiff at once, softer after a time, and slow to come back",
    equation="F = k x + ratio k (x - q), dq/dt = (x - q) / time",
    source="Christensen, Theory of Viscoelasticity (1982), ch. 1: standard linear solid",
    parameters=(
        Parameter(name="ratio", unit="1", low=0.0, high=5.0, step=0.2, null=0.0),
        Parameter(name="time", unit="s", low=0.03, high=10.0, step=0.3, logarithmic=True),
    ),
    traits=Traits(
        confounders=("hysteresis", "plasticity", "bending_damping", "quadratic_drag", "control_delay"),
        experiment="stretch it, wait for 5 s, let go and wait again: what relaxes comes back, what flowed does not",
        needs=frozenset({Need.SPRINGS}),
        measured_by=Measurement.RING_DOWN,
        degenerate_parameter="time",
        common_in=frozenset({"lattice"}),
    ),
    starts=starts,
    load=load,
)
