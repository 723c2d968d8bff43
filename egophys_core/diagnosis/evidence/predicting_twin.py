"""The twin that predicts best, of those between two baselines: the refitted one without an effect and that with it.

An effect comes with another baseline, which observers chose: it follows forces better where the effect shows, and may
predict worse where it does not (a right drag of 15 1/m: a pull from 6.8 to 10.3 mm). Free rollouts of all recordings
choose between the two, with the effect and without alike, so that errors before and after have had the same choice.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, with_values
from egophys_core.diagnosis.evidence.free_rollouts import FreeErrors
from egophys_core.twin import ObjectModel

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of the way from the first baseline to the second, in steps of their parameters."""


def between(one: ObjectModel, other: ObjectModel) -> list[ObjectModel]:
    """Models from one to the other, without effects; only these two if their graphs differ."""
    one, other = replace(one, effects=()), replace(other, effects=())
    if not np.array_equal(one.graph.springs, other.graph.springs):
        return [one, other]
    own = baseline_parameters(one)
    first, last = (
        np.array([parameter.position(model) for parameter in baseline_parameters(model)]) for model in (one, other)
    )
    inner = [with_values(one, own, (1.0 - share) * first + share * last) for share in SHARES[1:-1]]
    return [one, *inner, other]


def best_predicting(errors: Sequence[Sequence[FreeErrors]]) -> int:
    """Which of several models predicts best, by the geometric mean of its track errors.

    Args:
        errors: per episode, of each model.
    """
    tracks = np.array([[np.nanmean(each.track) for each in of_episode] for of_episode in errors])
    return int(np.log(np.maximum(tracks, np.finfo(float).tiny)).mean(axis=0).argmin())
