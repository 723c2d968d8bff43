"""Material that rubs within itself: another force on the way out than on the way back, however slow."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.traits import Need, Traits


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """The friction between fibres: elastic within a frame, z from where it slipped to up to its start.

    So friction only ever takes energy. A load that held z itself would swing from frame to frame as soon as the
    strength is above 1.
    """
    strain, strength, scale = scene.strain, values["strength"], values["strain"]
    z, before = (np.zeros_like(strain), strain) if memory is None else memory
    z = followed(z, (strain - before) / scale)
    shift = strength / (1.0 + strength) * (strain - scale * z)
    return (
        Load(stiffness_factor=np.full(len(strain), 1.0 + strength), rest_shift=shift * scene.rest_lengths),
        (z, strain),
    )


def followed(z: np.ndarray, way: np.ndarray) -> np.ndarray:
    """z after a way in one direction, exactly: straight back to 0, from there towards 1 or -1 exponentially."""
    direction = np.sign(way)
    ahead, left = direction * z, np.abs(way)
    back = np.minimum(left, np.maximum(-ahead, 0.0))
    reached = 1.0 - (1.0 - ahead - back) * np.exp(back - left)
    return np.where(direction == 0.0, z, direction * reached)


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
    load=load,
)
