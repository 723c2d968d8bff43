"""Material that is stiffer along one direction than across it."""

from dataclasses import replace

import numpy as np

from egophys_core.effects.effect import Body, Effect, Parameter, Surroundings, Values
from egophys_core.effects.places import longest_axes
from egophys_core.effects.traits import Need, Traits

LEAST_FACTOR = 0.05
"""No direction becomes softer than this."""


def adapt(values: Values, body: Body) -> Body:
    """Stiffness by the direction of the spring at rest; springs out of the plane change less."""
    ends = body.rest_positions[body.springs]
    along = ends[:, 1] - ends[:, 0]
    first, second = longest_axes(np.ptp(body.rest_positions, axis=0))
    u, v = along[:, first], along[:, second]
    squared = np.einsum("ij,ij->i", along, along)
    factor = 1.0 + (values["cosine"] * (u**2 - v**2) + values["sine"] * 2.0 * u * v) / squared
    return replace(body, stiffness=body.stiffness * np.maximum(factor, LEAST_FACTOR))


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"cosine": 0.1, "sine": 0.1}]


EFFECT = Effect(
    name="anisotropy",
    summary="stiffness that depends on the direction in the object, as along and across the weave of a fabric",
    equation="k(angle) = k (1 + cosine cos 2 angle + sine sin 2 angle), angle from the longest to the next side",
    source="Kilby, J. Textile Institute 54 (1963) T9: planar stress-strain relationships in woven fabrics",
    parameters=tuple(
        Parameter(name=name, unit="1", low=-0.9, high=0.9, step=0.1, null=0.0) for name in ("cosine", "sine")
    ),
    traits=Traits(
        confounders=("uneven_mass", "strain_stiffening", "tension_compression_asymmetry"),
        experiment="let it hang from one side, then from the next side, then from a corner",
        needs=frozenset({Need.SPRINGS}),
    ),
    starts=starts,
    adapt=adapt,
)
