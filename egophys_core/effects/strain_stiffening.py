"""Material that becomes stiffer the more it is stretched."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, Parameter, SpringLaw, Surroundings, Values
from egophys_core.effects.traits import Need, Traits
from egophys_core.lanes import LANES, Lanes

LARGEST_RISE = 6.0
"""Secant stiffness gained at most, over that at rest: what a simulation can still afford."""


@wp.func
def stiffened(
    strain: Lanes, first: Lanes, second: Lanes, dt: Lanes, begun: Lanes, a: Lanes, b: Lanes, c: Lanes, d: Lanes
):
    """Secant stiffness 1 + c e^2 of a stretched spring; numbers: c."""
    factor = Lanes()
    for lane in range(LANES):
        stretch = wp.max(strain[lane], 0.0)
        factor[lane] = 1.0 + wp.min(a[lane] * stretch * stretch, LARGEST_RISE)
    return factor, Lanes(), first, second


def numbers(values: Values, body: Body) -> np.ndarray:
    """[1] c."""
    return np.array([values["coefficient"]])


def stiffening(numbers: np.ndarray, strains: np.ndarray) -> np.ndarray:
    """[K] the slope 1 + 3 c e^2."""
    return 1.0 + 3.0 * np.minimum(numbers[:, 0] * np.maximum(strains, 0.0) ** 2, LARGEST_RISE)


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
    spring_law=SpringLaw(function=stiffened, numbers=numbers, stiffening=stiffening, follows_strain=True),
)
