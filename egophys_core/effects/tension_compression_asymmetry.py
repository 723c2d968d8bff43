"""Material that is stiffer, or softer, when pressed than when pulled."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, Parameter, SpringLaw, Surroundings, Values
from egophys_core.effects.traits import Need, Traits
from egophys_core.lanes import LANES, Lanes


@wp.func
def pressed_otherwise(
    strain: Lanes, first: Lanes, second: Lanes, dt: Lanes, begun: Lanes, a: Lanes, b: Lanes, c: Lanes, d: Lanes
):
    """Stiffness 1 + change of a spring that is shorter than at rest; numbers: change."""
    factor = Lanes()
    for lane in range(LANES):
        factor[lane] = 1.0 + a[lane] * wp.step(strain[lane])
    return factor, Lanes(), first, second


def numbers(values: Values, body: Body) -> np.ndarray:
    """[1] the change."""
    return np.array([values["change"]])


def stiffening(numbers: np.ndarray, strains: np.ndarray) -> np.ndarray:
    """[K] the larger of both slopes."""
    return np.maximum(1.0, 1.0 + numbers[:, 0])


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
    spring_law=SpringLaw(function=pressed_otherwise, numbers=numbers, stiffening=stiffening),
)
