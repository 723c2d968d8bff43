"""Material that relaxes: part of its force fades while it is kept stretched."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, Parameter, SpringLaw, Surroundings, Values
from egophys_core.effects.traits import Measurement, Need, Traits
from egophys_core.lanes import Lanes
from egophys_core.lanes.exponential import gone


@wp.func
def relaxing(
    strain: Lanes, first: Lanes, second: Lanes, dt: Lanes, begun: Lanes, a: Lanes, b: Lanes, c: Lanes, d: Lanes
):
    """A Maxwell arm beside the spring: stiffness for both, and a rest length between theirs.

    Numbers: ratio; ratio / (1 + ratio); 1 / time, 1/s. It remembers the strain of the arm's dashpot.
    """
    relaxed = first + wp.cw_mul(gone(wp.cw_mul(dt, c)), strain - first)
    return Lanes(1.0) + a, wp.cw_mul(b, first), relaxed, second


def numbers(values: Values, body: Body) -> np.ndarray:
    """[3] what `relaxing` reads."""
    ratio = values["ratio"]
    return np.array([ratio, ratio / (1.0 + ratio), 1.0 / values["time"]])


def stiffening(numbers: np.ndarray, strains: np.ndarray) -> np.ndarray:
    """[K] spring and arm together."""
    return 1.0 + numbers[:, 0]


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Relaxation within a ring-down's period, within a lift and over the episode."""
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
        measured_by=(Measurement.RING_DOWN,),
        degenerate_parameter="time",
        common_in=frozenset({"lattice"}),
    ),
    starts=starts,
    spring_law=SpringLaw(function=relaxing, numbers=numbers, memories=1, stiffening=stiffening),
)
