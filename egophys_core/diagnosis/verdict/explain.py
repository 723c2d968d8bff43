"""The explanation: what was measured directly, and what searches name beside it, one effect after the other."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from egophys_core.diagnosis.diagnosis import Decision, Outcome
from egophys_core.diagnosis.direct.measure import MeasuredEffect
from egophys_core.diagnosis.evidence.baseline_twin import BaselineTwin
from egophys_core.diagnosis.evidence.judging import RefittedEffect
from egophys_core.diagnosis.evidence.refit import Fitted
from egophys_core.diagnosis.problem import DiagnosisProblem, Progress
from egophys_core.diagnosis.verdict.rules import experiment_for
from egophys_core.diagnosis.verdict.search import search
from egophys_core.diagnosis.verdict.search_verdict import Search

ROUNDS = 2
"""Of naming an effect: what was measured is one, and what a search names."""


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """What a twin lacks."""

    outcome: Outcome
    named: tuple[MeasuredEffect | RefittedEffect, ...]
    """The effects named, then those that cannot be told apart, the best of them first."""
    ambiguous: tuple[str, ...]
    """Names of those that cannot be told apart."""
    reason: str
    experiment: str | None
    fitted: Fitted
    """With them, or with the best of them."""
    searches: tuple[Search, ...]
    decisions: tuple[Decision, ...]
    """Of each search."""


def explain(
    problem: DiagnosisProblem,
    baseline: BaselineTwin,
    measured: Sequence[MeasuredEffect],
    without: Collection[str],
    progress: Progress,
) -> Explanation:
    """Search beside the baseline, and again beside what was named.

    Args:
        problem: the episodes.
        baseline: the twin with those of the measured effects that show.
        measured: the effects that were measured; none of them is searched for.
        without: names of effects that are left out.
        progress: called with stage and share done.
    """
    shown = [each for each in measured if each.shows]
    named: list[MeasuredEffect | RefittedEffect] = [*shown]
    reasons = [each.reason for each in shown]
    fitted, others, searches = baseline.fitted, baseline.others, list[Search]()
    decisions: list[Decision] = []
    rounds = ROUNDS - bool(shown)
    known = {*without, *(each.name for each in measured)}
    for index in range(rounds):

        def report(stage: str, share: float, done: int = index) -> None:
            progress(stage, (done + share) / rounds)

        without_these = {*known, *(each.name for each in named)}
        found = search(problem, fitted, without_these, report, tried=baseline.tried, others=others)
        searches.append(found)
        decisions.append(replace(found.verdict.decision, beside=tuple(each.name for each in named)))
        if found.verdict.outcome != Outcome.NAMED:
            break
        named.append(found.verdict.named[0])
        reasons.append(found.verdict.reason)
        fitted, others = found.verdict.named[0].fitted, []
        problem = replace(problem, thresholds=problem.thresholds.beside(found.verdict.named[0].gain))
    last = searches[-1].verdict
    ambiguous: dict[str, MeasuredEffect | RefittedEffect] = {
        other.name: other for each in shown if each.alike for other in (each, *each.alike)
    }
    if last.outcome == Outcome.AMBIGUOUS:
        ambiguous |= {each.name: each for each in last.named}
        fitted = last.named[0].fitted
    elif not named:
        fitted = searches[-1].before
    certain = [each for each in named if each.name not in ambiguous]
    if ambiguous:
        outcome = Outcome.NAMED_AND_AMBIGUOUS if certain else Outcome.AMBIGUOUS
    elif not certain:
        outcome = last.outcome
    elif last.outcome in (Outcome.NAMED, Outcome.NONE):
        outcome = Outcome.NAMED
    else:
        outcome = Outcome.NAMED_AND_UNEXPLAINED
    named = [*certain, *ambiguous.values()]
    if last.outcome != Outcome.NAMED and (outcome != Outcome.NAMED or not named):
        reasons.append(last.reason)
    experiment = last.experiment
    if ambiguous and experiment is None:
        experiment = experiment_for(next(iter(ambiguous)), one_motion=len(problem.observations) < 2)
    return Explanation(
        outcome=outcome,
        named=tuple(named),
        ambiguous=tuple(ambiguous),
        reason="; beside it, ".join(reasons),
        experiment=experiment,
        fitted=fitted,
        searches=tuple(searches),
        decisions=tuple(decisions),
    )
