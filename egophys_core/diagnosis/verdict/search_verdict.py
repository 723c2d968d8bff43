"""What a search ends with: the verdict on the effects that were judged, tested where they were not fitted first."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from egophys_core.diagnosis.evidence.baseline_twin import TriedTwin
from egophys_core.diagnosis.evidence.generic_law import Law, find_law
from egophys_core.diagnosis.evidence.judging import RefittedEffect, validated
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.other_twins import OtherTwin, beside_other_twins, other_twins
from egophys_core.diagnosis.evidence.predicting_twin import shares_left
from egophys_core.diagnosis.evidence.refit import Fitted, median_size
from egophys_core.diagnosis.hypotheses.model_selection import NEARLY
from egophys_core.diagnosis.hypotheses.ranking import Probe, Ranking
from egophys_core.diagnosis.hypotheses.survey import Criteria, Promise, Survey
from egophys_core.diagnosis.problem import DiagnosisProblem
from egophys_core.diagnosis.verdict.decide import Verdict, decide, nearest_miss


@dataclass(frozen=True, kw_only=True)
class Judged:
    """The effects refitted and judged on one scale of the residuals."""

    before: Fitted
    """Without any of them."""
    promise: Promise
    refitted: list[RefittedEffect]
    criteria: Criteria
    """What kept each effect from a refit, or would have."""


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
    criteria: Criteria
    """Of every effect by name: those of the verdict, or what kept it from a refit."""


def concluded(
    problem: DiagnosisProblem,
    survey: Survey,
    judged: Judged,
    tried: Sequence[TriedTwin],
    progress: Callable[[str], None],
) -> Search:
    """What a search found, with the verdict on what was judged.

    Args:
        tried: other graphs and grasps of the twin.
        progress: called with the stage.
    """
    before, ranking, thresholds = judged.before, judged.promise.ranking, problem.thresholds
    linear = linear_problem(before.residuals, before.jacobian, before.scale)
    law = find_law(problem.observations, before.model, before.residuals, linear)
    progress("decide")
    tested = _tested_elsewhere(problem, judged)
    surrogate_shares = {each.name: ranking.share_of_surrogates(each.gain) for each in tested}

    def verdict_on(candidates: Sequence[RefittedEffect]) -> Verdict:
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

    refitted, verdict = _asked_beside_others(problem, before, tested, tried, verdict_on, progress)
    return Search(
        before=before,
        probes=survey.probes,
        ranking=ranking,
        refitted=refitted,
        law=law,
        verdict=verdict if verdict.named else _with_further_misses(verdict, judged),
        criteria={**judged.criteria, **verdict.criteria},
    )


def _asked_beside_others(
    problem: DiagnosisProblem,
    before: Fitted,
    refitted: list[RefittedEffect],
    tried: Sequence[TriedTwin],
    verdict_on: Callable[[Sequence[RefittedEffect]], Verdict],
    progress: Callable[[str], None],
) -> tuple[list[RefittedEffect], Verdict]:
    """The effects and the verdict, after what it would name, or the best of that, was asked for beside other twins."""
    observations, iterations = problem.observations, problem.options.refit_iterations
    others: Sequence[OtherTwin] | None = None
    verdict = verdict_on(refitted)
    while verdict.named and verdict.named[0].gains_beside_others is None:
        best = verdict.named[0]
        progress(f"ask of {best.name} beside other twins")
        if others is None:
            others = other_twins(observations, before, tried, iterations=iterations)
        asked = beside_other_twins(observations, best, others, iterations=iterations)
        refitted = [asked if each.name == best.name else each for each in refitted]
        verdict = verdict_on(refitted)
    return refitted, verdict


def _with_further_misses(verdict: Verdict, judged: Judged) -> Verdict:
    """A verdict that names nothing, with what kept the others from a refit, the most promising first."""
    order = sorted(judged.criteria.keys() - verdict.criteria.keys(), key=lambda name: -judged.promise.gains[name])
    misses = [miss for name in order if (miss := nearest_miss(name, judged.criteria[name]))]
    return replace(verdict, decision=verdict.decision.with_further_misses(misses))


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
