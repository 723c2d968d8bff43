"""The twin that predicts best, of those between two baselines: the refitted one without an effect and that with it.

An effect comes with another baseline, which observers chose: it follows forces better where the effect shows, and may
predict worse where it does not (a right drag of 15 1/m: a pull from 6.8 to 10.3 mm). Free rollouts of all recordings
choose between the two, with the effect and without alike, so that errors before and after have had the same choice.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, with_values
from egophys_core.diagnosis.evidence.free_rollouts import FreeErrors, free_errors
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
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


def predicting_pair(
    without: ObjectModel, fitted: ObjectModel, observations: Sequence[TrackedEpisode], *, given: int
) -> tuple[ObjectModel, ObjectModel, list[tuple[FreeErrors, FreeErrors]]]:
    """The models before and after that predict the given episodes best, and their errors in all.

    Args:
        without: refitted without the effects that were found.
        fitted: refitted with them; both may carry others.
        observations: those of the given episodes first.
        given: so many.
    """
    baselines = between(without, fitted)
    before = [replace(each, effects=without.effects) for each in baselines]
    after = [replace(each, effects=fitted.effects) for each in baselines] if fitted.effects != without.effects else []
    tried, count = [*before, *after], len(baselines)
    errors = [free_errors(each, tried) for each in observations]
    first = best_predicting([each[:count] for each in errors[:given]])
    last = len(after) + best_predicting([each[-count:] for each in errors[:given]])
    return tried[first], tried[last], [(each[first], each[last]) for each in errors]


def shares_left(without: ObjectModel, fitted: ObjectModel, observations: Sequence[TrackedEpisode]) -> np.ndarray:
    """[E] of the track errors of free rollouts in each episode, what is left by the effects that `fitted` has more.

    Args:
        without: refitted without these.
        fitted: refitted with them.
        observations: E episodes, which choose the baseline for both.
    """
    _, _, errors = predicting_pair(without, fitted, observations, given=len(observations))
    return np.array([np.nanmean(after.track) / np.nanmean(before.track) for before, after in errors])
