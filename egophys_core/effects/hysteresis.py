"""Material that rubs within itself: another force on the way out than on the way back, however slow."""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, Parameter, SpringLaw, Surroundings, Values
from egophys_core.effects.traits import Need, Traits
from egophys_core.lanes import LANES, Lanes


@wp.func
def rubbing(
    strain: Lanes, first: Lanes, second: Lanes, dt: Lanes, begun: Lanes, a: Lanes, b: Lanes, c: Lanes, d: Lanes
):
    """The friction between fibres: within a step it is elastic, from where z was; then z follows the strain.

    Numbers: strength; strength / (1 + strength); scale; 1 / scale. It remembers z and the strain that z followed.
    What z goes towards 0 it goes straight, what it goes away from 0 it goes exponentially towards 1 or -1: by
    1 / (1 + u + u^2 / 2) for exp(-u), u = de / scale being small within a step.
    """
    z = Lanes()
    followed = Lanes()
    for lane in range(LANES):
        # A rollout that has done all of its substeps waits for others, and remembers what it did.
        advances = wp.step(-dt[lane])
        followed[lane] = wp.where(advances > 0.0, strain[lane], second[lane])
        change = begun[lane] * advances * d[lane] * (strain[lane] - second[lane])
        there = first[lane] + change
        # What of the change leads away from 0.
        away = wp.max(wp.min(there, wp.max(change, 0.0)), wp.min(change, 0.0))
        size = wp.abs(away)
        half = 0.5 * size
        z[lane] = (there + away * half) / (1.0 + size + size * half)
    # In the first step there is no strain to have come from.
    return Lanes(1.0) + wp.cw_mul(begun, a), wp.cw_mul(b, second - wp.cw_mul(c, first)), z, followed


def numbers(values: Values, body: Body) -> np.ndarray:
    """[4] what `rubbing` reads."""
    strength, scale = values["strength"], values["strain"]
    return np.array([strength, strength / (1.0 + strength), scale, 1.0 / scale])


def stiffening(numbers: np.ndarray, strains: np.ndarray) -> np.ndarray:
    """[K] before fibres slip."""
    return 1.0 + numbers[:, 0]


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Fibres that slip early, or late."""
    return [{"strength": 0.2, "strain": strain} for strain in (0.02, 0.1)]


EFFECT = Effect(
    name="hysteresis",
    summary="springs with friction between fibres: the way back differs from the way out, however slow",
    equation="F = k l0 (e + strength strain z), dz = (1 - |z| (1 + sign(z de)) / 2) de / strain (Bouc-Wen, n = 1)",
    source="Wen, J. Engineering Mechanics Division ASCE 102 (1976) 249",
    parameters=(
        Parameter(name="strength", unit="1", low=0.0, high=3.0, step=0.2, null=0.0),
        Parameter(name="strain", unit="1", low=0.005, high=0.5, step=0.3, logarithmic=True),
    ),
    traits=Traits(
        confounders=("viscoelasticity", "plasticity", "bending_damping", "strain_stiffening"),
        experiment="stretch and release it in a slow cycle and in one ten times slower: only what relaxes "
        "tells them apart",
        needs=frozenset({Need.SPRINGS}),
        degenerate_parameter="strain",
    ),
    starts=starts,
    spring_law=SpringLaw(function=rubbing, numbers=numbers, memories=2, stiffening=stiffening),
)
