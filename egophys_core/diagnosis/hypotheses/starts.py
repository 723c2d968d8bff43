"""Where joint refits with an effect start.

An object that falls over where the real one lies still is far from anything linear; and what a twin without the
effect was bent to, to make up for it, may hold the effect back. So many starts are simulated, and the best of them are
refitted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import at_share, with_effect, with_values
from egophys_core.diagnosis.evidence.refit import Fitted, best_of_each, losses_of
from egophys_core.diagnosis.hypotheses.large_amplitude import there_and_beyond
from egophys_core.diagnosis.hypotheses.ranking import RankedEffect
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.twin import ObjectModel

SHARES = (0.25, 0.5, 1.0, 2.0)
"""Of the distance to an optimum at which a refit may start; the linear one lies short of or beyond the true one."""


def starts_beside(
    observations: Sequence[TrackedEpisode],
    before: Fitted,
    ranked: RankedEffect,
    others: Sequence[ObjectModel],
    far: Sequence[ObjectModel],
) -> list[ObjectModel]:
    """The best point of each path from `before` to the effect, the best first.

    The path to the linear optimum is tried with and without the baseline's share, from `others` as well, and beside it
    the paths to all starts of the effect.

    Args:
        before: the twin without the effect.
        others: twins without it at which refits may start as well.
        far: starts with it that are known to be good.
    """
    effect = ranked.probe.effect
    baseline = np.array([parameter.position(before.model) for parameter in before.parameters])
    optima = [at_share(effect, ranked.values, share) for share in SHARES]
    paths = [
        [
            with_effect(with_values(before.model, before.parameters, moved), effect.name, values)
            for share, values in zip(SHARES, optima, strict=True)
            for moved in (baseline, baseline + min(share, 1.0) * ranked.baseline_steps)
        ],
        *([with_effect(other, effect.name, values) for values in optima] for other in others),
        *_afar(before.model, ranked),
        *([start] for start in far),
    ]
    return _best_of_each(observations, paths, before.scale)


def starts_from_rival(
    observations: Sequence[TrackedEpisode],
    ranked: RankedEffect,
    values: Mapping[str, float],
    rival: ObjectModel,
    scale: float,
) -> list[ObjectModel]:
    """The best point of each path to the effect from the twin that a rival left, without the rival; the best first.

    Where the rival explains much, its twin has bent less to make up for what both explain.

    Args:
        values: where a refit with the effect ended.
        rival: the twin with the rival effect.
    """
    effect, baseline = ranked.probe.effect, replace(rival, effects=rival.effects[:-1])
    paths = [
        [with_effect(baseline, effect.name, at_share(effect, values, share)) for share in SHARES],
        *_afar(baseline, ranked),
    ]
    return _best_of_each(observations, paths, scale)


def _afar(baseline: ObjectModel, ranked: RankedEffect) -> list[list[ObjectModel]]:
    """The paths to all starts of an effect: there, and at large amplitudes."""
    effect = ranked.probe.effect
    return [there_and_beyond(baseline, effect, start) for start in ranked.starts]


def _best_of_each(
    observations: Sequence[TrackedEpisode], paths: Sequence[Sequence[ObjectModel]], scale: float
) -> list[ObjectModel]:
    """The model of least loss of each path, the best first."""
    return best_of_each(paths, losses_of(observations, [model for path in paths for model in path], scale))
