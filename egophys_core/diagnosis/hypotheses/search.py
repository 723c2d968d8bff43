"""One search: which effect, beside those a fitted twin carries, explains what it leaves unexplained."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from egophys_core.diagnosis.criterion import CriterionResult, Direction, compare
from egophys_core.diagnosis.evidence.baseline_twin import TriedTwin
from egophys_core.diagnosis.evidence.generic_law import Law, find_law
from egophys_core.diagnosis.evidence.judging import RefittedEffect, judge, validated
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.other_twins import OtherTwin, beside_other_twins, other_twins
from egophys_core.diagnosis.evidence.predicting_twin import shares_left
from egophys_core.diagnosis.evidence.refit import Fitted, median_size, refit_further, robust_loss
from egophys_core.diagnosis.hypotheses.large_amplitude import (
    LargeAmplitudeProbe,
    large_amplitude_gains,
    probe_at_large_amplitude,
)
from egophys_core.diagnosis.hypotheses.model_selection import NEARLY, select_models
from egophys_core.diagnosis.hypotheses.ranking import Probe, RankedEffect, Ranking, probe_effects, rank
from egophys_core.diagnosis.hypotheses.rod_starts import RodStart, rod_starts
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.problem import DiagnosisProblem, Progress
from egophys_core.diagnosis.verdict.decide import Verdict, decide, nearest_miss
from egophys_core.effects import LIBRARY
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel

Criteria = dict[str, tuple[CriterionResult, ...]]
"""Per effect what it was held against."""

FINER = 0.7
"""Of the scale of the residuals: where an effect leaves less, all are judged again by what it leaves."""

OUT_OF_STEP_M = 0.002
"""Metres: scale of residuals from which a cable may be out of phase with its twin; then slopes there say nothing."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """What one search found."""

    before: Fitted
    probes: Sequence[Probe]
    """What the effects do to the residuals, at all their starts."""
    ranking: Ranking
    refitted: list[RefittedEffect]
    law: Law
    verdict: Verdict
    criteria: Mapping[str, tuple[CriterionResult, ...]]
    """Of every effect by name: those of the verdict, or what kept it from a refit."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """The effects refitted and judged on one scale of the residuals."""

    before: Fitted
    """Without any of them."""
    promise: "Promise"
    refitted: list[RefittedEffect]
    criteria: Criteria
    """What kept each effect from a refit, or would have."""


@dataclass(frozen=True, kw_only=True)
class Promise:
    """What the effects may gain in a refit."""

    ranking: Ranking
    """By slopes alone."""
    gains: Mapping[str, float]
    """Per effect the largest held-out gain by its slopes, by large-amplitude probes, or on rods."""

    def worth_a_refit(self, refit_gain: float) -> list[RankedEffect]:
        """The effects that promise at least so much, the most promising first."""
        worth = [each for each in self.ranking.ranked if self.gains[each.name] >= refit_gain]
        return sorted(worth, key=lambda each: -self.gains[each.name])

    def criteria(self, worth: Sequence[RankedEffect], options: DiagnosisOptions, refit_gain: float) -> Criteria:
        """What keeps each effect from a refit, unless there is another reason for one.

        Args:
            worth: those that are worth it, the most promising first.
        """
        found: Criteria = {}
        for name, gain in self.gains.items():
            what, because = "held-out gain by slopes and large-amplitude probes:", " to be worth a refit"
            found[name] = (compare("worth_a_refit", what, gain, Direction.AT_LEAST, refit_gain, because=because),)
        for place, each in enumerate(worth, start=1):
            what = "place in the order of held-out gains by slopes and large-amplitude probes:"
            found[each.name] += (compare("shortlist", what, place, Direction.AT_MOST, options.shortlist, unit="1"),)
        return found


@dataclass(frozen=True, kw_only=True)
class Survey:
    """What the effects do, nearby and far off; simulated once for all scales of the residuals."""

    fitted: Fitted
    """Where from."""
    probes: list[Probe]
    large_amplitude_probes: list[LargeAmplitudeProbe]
    on_rods: dict[str, list[RodStart]]
    """Of a cable, by effect, the best first."""

    def promise(self, scale: float, *, surrogates: int, seed: int) -> Promise:
        """What the effects promise, judged by residuals of a scale."""
        linear = linear_problem(self.fitted.residuals, self.fitted.jacobian, scale)
        ranking = rank(linear, self.probes, surrogates=surrogates, seed=seed)
        far = large_amplitude_gains(linear, self.large_amplitude_probes)
        known = robust_loss(self.fitted.residuals, scale)
        rods = {name: known - min(start.loss(scale) for start in starts) for name, starts in self.on_rods.items()}
        gains = {
            each.name: max(each.held_out_gain, far.get(each.name, 0.0), rods.get(each.name, 0.0))
            for each in ranking.ranked
        }
        return Promise(ranking=ranking, gains=gains)


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
    survey = _survey(problem, before, without, lambda share: progress("probe the effects", 0.3 * share))
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
    return _decided(problem, survey, found, tried, lambda stage: progress(stage, 0.9))


def _survey(
    problem: DiagnosisProblem, fitted: Fitted, without: Collection[str], progress: Callable[[float], None]
) -> Survey:
    """Simulate the effects at all their starts, and farther off at the best of these."""
    progress(0.0)
    probes = probe_effects(
        problem.observations,
        fitted.model,
        fitted.residuals,
        without=without,
        progress=lambda share: progress(0.6 * share),
    )
    nearby = rank(
        linear_problem(fitted.residuals, fitted.jacobian, fitted.scale), probes, surrogates=0, seed=problem.seed
    )
    large_amplitude_probes = probe_at_large_amplitude(
        problem.observations, fitted.model, nearby.ranked, progress=lambda share: progress(0.6 + 0.2 * share)
    )
    on_rods = {}
    if kind_of(fitted.model).is_line and fitted.scale > OUT_OF_STEP_M:
        on_rods = rod_starts(
            problem.observations,
            fitted.model,
            nearby.ranked,
            fitted.scale,
            progress=lambda share: progress(0.8 + 0.2 * share),
        )
    return Survey(fitted=fitted, probes=probes, large_amplitude_probes=large_amplitude_probes, on_rods=on_rods)


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


def _decided(
    problem: DiagnosisProblem,
    survey: Survey,
    judged: Judged,
    tried: Sequence[TriedTwin],
    progress: Callable[[str], None],
) -> Search:
    """The verdict on what was judged; what it would name, or the best of that, is asked beside other twins first."""
    before, ranking, thresholds = judged.before, judged.promise.ranking, problem.thresholds
    iterations = problem.options.refit_iterations
    linear = linear_problem(before.residuals, before.jacobian, before.scale)
    law = find_law(problem.observations, before.model, before.residuals, linear)
    progress("decide")
    refitted = _tested_elsewhere(problem, judged)
    surrogate_shares = {each.name: ranking.share_of_surrogates(each.gain) for each in refitted}

    def decided(candidates: Sequence[RefittedEffect]) -> Verdict:
        return decide(
            candidates,
            surrogate_shares,
            law.held_out_gain if ranking.share_of_surrogates(law.held_out_gain) <= thresholds.largest_p else 0.0,
            len(problem.observations),
            beside_named=bool(before.model.effects),
            residual_m=median_size(before.residuals),
            free_residual_m=survey.fitted.scale if problem.observations[0].free else None,
            thresholds=thresholds,
        )

    verdict = decided(refitted)
    others: Sequence[OtherTwin] | None = None
    while verdict.named and verdict.named[0].gains_beside_others is None:
        best = verdict.named[0]
        progress(f"ask of {best.name} beside other twins")
        if others is None:
            others = other_twins(problem.observations, before, tried, iterations=iterations)
        asked = beside_other_twins(problem.observations, best, others, iterations=iterations)
        refitted = [asked if each.name == best.name else each for each in refitted]
        verdict = decided(refitted)
    criteria = {**judged.criteria, **verdict.criteria}
    if not verdict.named:
        order = sorted(judged.criteria.keys() - verdict.criteria.keys(), key=lambda name: -judged.promise.gains[name])
        misses = [miss for name in order if (miss := nearest_miss(name, judged.criteria[name]))]
        verdict = replace(verdict, decision=verdict.decision.with_further_misses(misses))
    return Search(
        before=before,
        probes=survey.probes,
        ranking=ranking,
        refitted=refitted,
        law=law,
        verdict=verdict,
        criteria=criteria,
    )


def _tested_elsewhere(problem: DiagnosisProblem, judged: Judged) -> list[RefittedEffect]:
    """The effects with what validation episodes and, beside a named one, free rollouts say of them."""
    refitted, before, thresholds = judged.refitted, judged.before, problem.thresholds
    best = max((each.gain for each in refitted), default=0.0)
    if problem.validation and best >= NEARLY * thresholds.least_gain:
        chosen_gain = thresholds.special_case_share * best
        rivals = [each for each in refitted if each.gain >= chosen_gain]
        rest = [each for each in refitted if each.gain < chosen_gain]
        refitted = [*validated(rivals, before, problem.validation), *rest]
    if before.model.effects:
        refitted = [_predicting(each, before, problem) for each in refitted]
    return refitted


def _predicting(candidate: RefittedEffect, before: Fitted, problem: DiagnosisProblem) -> RefittedEffect:
    """A candidate with what it leaves of the errors of free rollouts, if it gains enough for that to matter."""
    if candidate.gain < problem.thresholds.second_gain:
        return candidate
    episodes = [*problem.observations, *problem.validation]
    return replace(candidate, shares_left=shares_left(before.model, candidate.fitted.model, episodes))
