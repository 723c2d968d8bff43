"""Material that stays deformed when it was strained too far."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, Parameter, SpringLaw, Surroundings, Values
from egophys_core.effects.traits import Need, Traits
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.exponential import gone

LARGEST_SET = 0.8
"""Share of its length that a spring can lose or gain for good."""


@wp.func
def flowing(
    strain: Lanes, first: Lanes, second: Lanes, dt: Lanes, begun: Lanes, a: Lanes, b: Lanes, c: Lanes, d: Lanes
):
    """Rest lengths flow by the strain beyond the yield strain (a return map, Simo and Hughes, sec. 1.7).

    Numbers: yield strain; flow, 1/s. It remembers the strain that stays.
    """
    share = gone(wp.cw_mul(dt, b))
    lasting = Lanes()
    for lane in range(LANES):
        elastic = strain[lane] - first[lane]
        excess = wp.max(elastic - a[lane], 0.0) + wp.min(elastic + a[lane], 0.0)
        lasting[lane] = wp.min(wp.max(first[lane] + share[lane] * excess, -LARGEST_SET), LARGEST_SET)
    return Lanes(1.0), first, lasting, second


def numbers(values: Values, body: Body) -> np.ndarray:
    """[2] what `flowing` reads."""
    return np.array([values["yield_strain"], values["flow"]])


def stiffening(numbers: np.ndarray, strains: np.ndarray) -> np.ndarray:
    """[K] none: a plastic spring is at most as stiff as an elastic one."""
    return np.ones(len(numbers))


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
    spring_law=SpringLaw(function=flowing, numbers=numbers, memories=1, stiffening=stiffening),
)
