"""One search: which effect, beside those a fitted twin carries, explains what it leaves unexplained."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from egophys_core.diagnosis.evidence.baseline_twin import TriedTwin
from egophys_core.diagnosis.evidence.judging import judge
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.refit import Fitted, refit_further
from egophys_core.diagnosis.hypotheses.model_selection import select_models
from egophys_core.diagnosis.hypotheses.survey import Survey, survey_effects
from egophys_core.diagnosis.problem import DiagnosisProblem, Progress
from egophys_core.diagnosis.verdict.search_verdict import Judged, Search, concluded
from egophys_core.effects import LIBRARY
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel

FINER = 0.7
"""Of the scale of the residuals: where an effect leaves less, all are judged again by what it leaves."""


def search(
    problem: DiagnosisProblem,
    before: Fitted,
    without: Collection[str],
    progress: Progress,
    *,
    tried: Sequence[TriedTwin],
    others: Sequence[ObjectModel] = (),
) -> Search:
    """Probe, rank, refit the shortlist and decide.

    An effect that explains much leaves residuals far smaller than those it was judged by. Then all are judged again on
    that scale: what was hidden in the large ones counts now.

    Args:
        before: the twin refitted without any further effect.
        without: names of effects that are left out.
        tried: other graphs and grasps of the twin: what is named has to help these, too.
        others: twins without the effect at which refits may start as well.
    """
    survey = survey_effects(problem, before, without, lambda share: progress("probe the effects", 0.3 * share))
    found = _on_scale(problem, survey, before, others, lambda stage, share: progress(stage, 0.3 + 0.3 * share))
    left = min((each.left_m for each in found.refitted), default=before.scale)
    finest = max(left, problem.observations[0].least_scale)
    if finest < FINER * before.scale:
        finer = replace(found.before, scale=finest)
        before = refit_further(problem.observations, finer, iterations=problem.options.refit_iterations)
        earlier = {
            each.name: each.fitted.model for each in found.refitted if each.gain >= problem.thresholds.refit_gain
        }
        found = _on_scale(
            problem, survey, before, others, lambda stage, share: progress(stage, 0.6 + 0.3 * share), earlier=earlier
        )
    return concluded(problem, survey, found, tried, lambda stage: progress(stage, 0.9))


def _on_scale(
    problem: DiagnosisProblem,
    survey: Survey,
    before: Fitted,
    others: Sequence[ObjectModel],
    progress: Progress,
    *,
    earlier: Mapping[str, ObjectModel] = MappingProxyType({}),
) -> Judged:
    """The effects judged on the scale of the residuals `before`.

    Args:
        earlier: models with effects that were refitted on a coarser scale: judged whatever the ranking says.
    """
    options = problem.options
    refit_gain = problem.thresholds.refit_gain
    promise = survey.promise(before.scale, surrogates=options.surrogates, seed=problem.seed)
    ranking, worth = promise.ranking, promise.worth_a_refit(refit_gain)
    kind = kind_of(before.model).name
    common = {effect.name for effect in LIBRARY.values() if kind in effect.traits.common_in}
    chosen = {*(each.name for each in worth[: options.shortlist]), *common, *earlier}
    ended = select_models(
        problem,
        before,
        {each.name: each for each in ranking.ranked},
        [each.name for each in ranking.ranked if each.name in chosen],
        [each.name for each in worth if each.name not in chosen],
        progress,
        earlier=earlier,
        others=others,
        far={name: [start.model for start in starts] for name, starts in survey.on_rods.items()},
    )
    before = ended.before
    linear = linear_problem(before.residuals, before.jacobian, before.scale)
    return Judged(
        before=before,
        promise=promise,
        refitted=[
            judge(name, fitted, before, linear, bootstraps=options.bootstraps, seed=problem.seed)
            for name, fitted in ended.fits.items()
        ],
        criteria=promise.criteria(worth, options, refit_gain),
    )
