"""The verdict: from refitted candidates to one outcome, by named criteria and an ordered table of rules.

A twin is never right, and what it lacks anyway is soaked up by some effects of the library, several of them alike; what
gains no more than that is no sign of an effect (docs/notes/discrepancy.md). A true effect stands alone, but for its
confounders.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from egophys_core.diagnosis.criterion import CriterionResult
from egophys_core.diagnosis.diagnosis import MOST_MISSES, Decision, NearestMiss, Outcome
from egophys_core.diagnosis.evidence.judging import RefittedEffect
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.verdict.comparison import (
    has_no_equivalent,
    is_horizontal,
    is_outdone,
    rivals_the_best,
    special_case_explains_less,
    special_case_predicts_less,
    told_apart,
)
from egophys_core.diagnosis.verdict.criteria import CRITERIA, SCREENS, SUPPORT, Setting
from egophys_core.diagnosis.verdict.penalised_gain import penalised_gain
from egophys_core.diagnosis.verdict.rules import Situation, Standing, first_ruling
from egophys_core.effects import effect_named, nested


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """An outcome and what it rests on."""

    outcome: Outcome
    named: tuple[RefittedEffect, ...]
    """The effect named, or those that cannot be told apart; the best first."""
    reason: str
    experiment: str | None
    decision: Decision
    criteria: Mapping[str, tuple[CriterionResult, ...]]
    """Of every candidate by name, in the order in which they are asked."""


def decide(
    candidates: Sequence[RefittedEffect],
    surrogate_shares: Mapping[str, float],
    law_gain: float,
    episodes: int,
    *,
    beside_named: bool = False,
    residual_m: float = 0.0,
    free_residual_m: float | None = None,
    thresholds: Thresholds | None = None,
) -> Verdict:
    """One outcome for refitted candidates, of which none or several may pass.

    Args:
        surrogate_shares: per effect the share of surrogates that gain as much.
        law_gain: held-out gain of the best generic law, 0 if surrogates gain as much.
        episodes: how many were fitted; one cannot show that an effect is the object's and not the motion's.
        beside_named: whether candidates would be named beside another effect.
        residual_m: median size of the residuals without an effect.
        free_residual_m: what free rollouts leave without an effect; None where observers follow the episodes.
        thresholds: what a candidate must reach; by default those of the project.
    """
    thresholds = thresholds or Thresholds()
    alone = Setting(
        thresholds=thresholds,
        surrogate_shares=surrogate_shares,
        beside_named=beside_named,
        free_residual_m=free_residual_m,
    )
    screened = {each.name: tuple(screen(each, alone) for screen in SCREENS) for each in candidates}
    ordered = sorted(
        (each for each in candidates if _passes(screened[each.name])),
        key=lambda each: penalised_gain(each, thresholds),
        reverse=True,
    )
    supported = [each for each in ordered if all(test(each, alone).passed for test in SUPPORT)]
    setting = replace(alone, others=supported)
    criteria = {
        each.name: (*screened[each.name], *(criterion(each, setting) for criterion in CRITERIA)) for each in candidates
    }
    standing = _compared(ordered, supported, criteria, setting)
    situation = Situation(
        setting=setting,
        ordered=ordered,
        supported=supported,
        standing=standing,
        nearest_misses=_nearest_misses(candidates, criteria),
        law_gain=law_gain,
        episodes=episodes,
        residual_m=residual_m,
    )
    rule, ruling = first_ruling(situation)
    return Verdict(
        outcome=ruling.outcome,
        named=ruling.named,
        reason=ruling.reason,
        experiment=ruling.experiment,
        decision=Decision(
            rule=rule.name,
            sentence=rule.sentence,
            candidate=ruling.candidate,
            criterion=ruling.criterion,
            beside=(),
            nearest_misses=() if ruling.named else situation.nearest_misses[:MOST_MISSES],
        ),
        criteria=criteria,
    )


def _nearest_misses(
    candidates: Sequence[RefittedEffect], criteria: Mapping[str, tuple[CriterionResult, ...]]
) -> tuple[NearestMiss, ...]:
    """The candidates that fail the fewest criteria, of these the ones that gain most first."""
    by_gain = sorted(candidates, key=lambda each: -each.gain)
    misses = [miss for each in by_gain if (miss := nearest_miss(each.name, criteria[each.name]))]
    return tuple(sorted(misses, key=lambda miss: len(miss.failed)))


def nearest_miss(name: str, results: Sequence[CriterionResult]) -> NearestMiss | None:
    """The criteria that a candidate fails, if it fails any."""
    failed = tuple(result for result in results if not result.passed)
    return NearestMiss(candidate=name, failed=failed) if failed else None


def _compared(
    ordered: Sequence[RefittedEffect],
    supported: Sequence[RefittedEffect],
    criteria: dict[str, tuple[CriterionResult, ...]],
    setting: Setting,
) -> Standing:
    """The candidates that pass on their own held against each other; adds to their criteria.

    Args:
        ordered: all candidates, by falling penalised gain.
        supported: those of them that pass `SUPPORT`.
    """
    thresholds = setting.thresholds
    passing = [each for each in ordered if _passes(criteria[each.name])]
    for each in passing:
        criteria[each.name] += (
            special_case_explains_less(each, passing, thresholds),
            special_case_predicts_less(each, supported, thresholds),
        )
    good = [each for each in passing if _passes(criteria[each.name])]
    if not good:
        return Standing(good=(), rivals=(), refuted_rivals=())
    best, *others = good
    near = [each for each in supported if each is not best and not is_outdone(each, good, thresholds)]
    rivals = [each for each in near if any(each is other for other in others)]
    equivalent = _equivalents(best, ordered, rivals)
    refuted = [each for each in near if each.name not in nested(best.name) and not (rivals or equivalent)]
    criteria[best.name] += (told_apart(best, rivals or refuted, thresholds), has_no_equivalent(best))
    for each in others:
        criteria[each.name] += (rivals_the_best(each, best, thresholds),)
    return Standing(good=tuple(good), rivals=(*rivals, *equivalent), refuted_rivals=tuple(refuted))


def _equivalents(
    best: RefittedEffect, ordered: Sequence[RefittedEffect], rivals: Sequence[RefittedEffect]
) -> list[RefittedEffect]:
    """Further candidates that are one thing with the best one under another name.

    That such a refit ended worse, or fails a criterion, says nothing of which of them it is.
    """
    names = effect_named(best.name).traits.equivalent_to if is_horizontal(best) else ()
    known = {each.name for each in rivals}
    return [each for each in ordered if each.name in names and each.name not in known and is_horizontal(each)]


def _passes(results: Sequence[CriterionResult]) -> bool:
    return all(each.passed for each in results)
