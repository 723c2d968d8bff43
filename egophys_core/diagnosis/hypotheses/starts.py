"""Where joint refits with an effect start.

An object that falls over where the real one lies still is far from anything linear; and what a twin without the
effect was bent to, to make up for it, may hold the effect back. So many starts are simulated, and the best of them are
refitted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import part_way, turned, with_effect
from egophys_core.diagnosis.evidence.refit import Fitted, robust_loss
from egophys_core.diagnosis.evidence.residuals import Observation, residuals
from egophys_core.diagnosis.hypotheses.large_amplitude import there_and_beyond
from egophys_core.diagnosis.hypotheses.ranking import Ranked
from egophys_core.twin import ObjectModel

SHARES = (0.25, 0.5, 1.0, 2.0)
"""Of the way to an optimum at which a refit may start; the linear one lies short of or beyond the true one."""


def starts_beside(
    observations: Sequence[Observation],
    before: Fitted,
    ranked: Ranked,
    others: Sequence[ObjectModel],
    far: Sequence[ObjectModel],
) -> list[ObjectModel]:
    """The best point of each way from `before` to the effect, the best first.

    The way to the linear optimum is tried with and without the base's share, from `others` as well, and beside it the
    ways to all starts of the effect.

    Args:
        before: the twin without the effect.
        others: twins without it at which refits may start as well.
        far: starts with it that are known to be good.
    """
    effect = ranked.probe.effect
    base = np.array([knob.position(before.model) for knob in before.knobs])
    optima = [part_way(effect, ranked.values, share) for share in SHARES]
    ways = [
        [
            with_effect(turned(before.model, before.knobs, moved), effect.name, values)
            for share, values in zip(SHARES, optima, strict=True)
            for moved in (base, base + min(share, 1.0) * ranked.base_steps)
        ],
        *([with_effect(other, effect.name, values) for values in optima] for other in others),
        *_afar(before.model, ranked),
        *([start] for start in far),
    ]
    return _best_of_each(observations, ways, before.scale)


def starts_from_rival(
    observations: Sequence[Observation], ranked: Ranked, values: Mapping[str, float], rival: ObjectModel, scale: float
) -> list[ObjectModel]:
    """The best point of each way to the effect from the twin that a rival left, without the rival; the best first.

    Where the rival explains much, its twin has bent less to make up for what both explain.

    Args:
        values: where a refit with the effect ended.
        rival: the twin with the rival effect.
    """
    effect, base = ranked.probe.effect, replace(rival, effects=rival.effects[:-1])
    ways = [
        [with_effect(base, effect.name, part_way(effect, values, share)) for share in SHARES],
        *_afar(base, ranked),
    ]
    return _best_of_each(observations, ways, scale)


def _afar(base: ObjectModel, ranked: Ranked) -> list[list[ObjectModel]]:
    """The ways to all starts of an effect: there, and leapt beyond."""
    effect = ranked.probe.effect
    return [there_and_beyond(base, effect, start) for start in ranked.starts]


def _best_of_each(
    observations: Sequence[Observation], ways: Sequence[Sequence[ObjectModel]], scale: float
) -> list[ObjectModel]:
    """The model of least loss of each way, the best first."""
    way = np.repeat(np.arange(len(ways)), [len(each) for each in ways])
    models = [model for each in ways for model in each]
    found = residuals(observations, models)
    order = np.argsort([robust_loss([each[row] for each in found], scale) for row in range(len(models))])
    _, firsts = np.unique(way[order], return_index=True)
    return [models[order[first]] for first in sorted(firsts)]
