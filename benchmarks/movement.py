"""By how much an injected effect moves the points: two rehearsals that differ in nothing else."""

from collections.abc import Mapping, Sequence

import numpy as np

from egophys_core.rehearsal.hands import CONTACT_BEGINS
from egophys_core.rehearsal.options import Motion, RehearsalOptions
from egophys_core.rehearsal.world import rehearse


def movement(
    options: RehearsalOptions,
    motions: Sequence[tuple[Motion, int]],
    effects: Mapping[str, Mapping[str, float]],
    *,
    object_seed: int,
) -> float:
    """Metres between the recorded places of a point with and without effects, mean over points, frames and motions.

    Args:
        options: the object, seen without noise, dropouts and occlusion.
        motions: each with the seed of its hands.
        effects: values by effect and parameter.
        object_seed: of the object.
    """
    apart = []
    for motion, seed in motions:
        with_them, without = (
            rehearse(options, motion, seed=seed, effects=each, object_seed=object_seed) for each in (effects, {})
        )
        touched = without.times > CONTACT_BEGINS
        apart.append(np.linalg.norm(with_them.points[touched] - without.points[touched], axis=2).mean())
    return float(np.mean(apart))
