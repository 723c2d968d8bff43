"""The explanation: what was measured directly, and what searches name beside it, one effect after the other."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from egophys_core.diagnosis.diagnosis import Decision, Outcome
from egophys_core.diagnosis.direct.measure import MeasuredEffect
from egophys_core.diagnosis.evidence.baseline_twin import BaselineTwin
from egophys_core.diagnosis.evidence.judging import RefittedEffect
from egophys_core.diagnosis.evidence.refit import Fitted
from egophys_core.diagnosis.hypotheses.search import search
from egophys_core.diagnosis.hypotheses.search_verdict import Search
from egophys_core.diagnosis.problem import DiagnosisProblem, Progress

ROUNDS = 2
"""Of naming an effect: what was measured is one, and what a search names."""


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """What a twin lacks."""

    outcome: Outcome
    named: tuple[MeasuredEffect | RefittedEffect, ...]
    """The effects named, and those that cannot be told apart, the best of them first."""
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
    outcome = Outcome.NAMED
    if not named:
        outcome = last.outcome
        fitted = searches[-1].before
    elif last.outcome == Outcome.AMBIGUOUS:
        outcome = Outcome.NAMED_AND_AMBIGUOUS
    elif last.outcome not in (Outcome.NAMED, Outcome.NONE):
        outcome = Outcome.NAMED_AND_UNEXPLAINED
    if last.outcome == Outcome.AMBIGUOUS:
        named += last.named
        fitted = last.named[0].fitted
    alike = [other for each in shown for other in each.alike]
    if alike:
        outcome = Outcome.AMBIGUOUS if len(named) == len(shown) == 1 else Outcome.NAMED_AND_AMBIGUOUS
        named += alike
    if last.outcome != Outcome.NAMED and (outcome != Outcome.NAMED or not named):
        reasons.append(last.reason)
    return Explanation(
        outcome=outcome,
        named=tuple(named),
        reason="; beside it, ".join(reasons),
        experiment=(last if last.outcome == Outcome.AMBIGUOUS else searches[0].verdict).experiment,
        fitted=fitted,
        searches=tuple(searches),
        decisions=tuple(decisions),
    )
