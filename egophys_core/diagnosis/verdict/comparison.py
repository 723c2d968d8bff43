"""How the candidates that pass on their own compare: with their special cases, and with the best of them."""

from collections.abc import Sequence

from egophys_core.diagnosis.criterion import CriterionResult, Direction, compare, not_asked, state
from egophys_core.diagnosis.evidence.judging import RefittedEffect
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.verdict.penalised_gain import (
    explains_less,
    needed_to_rival,
    penalised_gain,
    simpler,
)
from egophys_core.effects import effect_named


def special_case_explains_less(
    candidate: RefittedEffect, good: Sequence[RefittedEffect], thresholds: Thresholds
) -> CriterionResult:
    """Each special case of it that passes on its own explains clearly less; else the special case is named.

    Args:
        good: the candidates that pass on their own.
    """
    name = "special_case_explains_less"
    special = [each for each in good if each.name in simpler(candidate.name)]
    if not special:
        return not_asked(name, "more than its special cases explain: none of these passes")
    # One that explains as much decides, whatever the others do.
    rival = min(special, key=lambda each: explains_less(each, candidate, thresholds))
    gain, most = penalised_gain(rival, thresholds), needed_to_rival(rival, candidate, thresholds)
    what = f"penalised gain of its special case {rival.name}"
    return compare(name, what, gain, Direction.BELOW, most, because=", else that one is named")


def special_case_predicts_less(
    candidate: RefittedEffect, supported: Sequence[RefittedEffect], thresholds: Thresholds
) -> CriterionResult:
    """No special case of it, with a fair share of its gain, predicts more of the validation episodes.

    Args:
        supported: the candidates that neither validation episodes nor other twins speak against.
    """
    name = "special_case_predicts_less"
    special = [
        each
        for each in supported
        if each.name in simpler(candidate.name) and each.gain >= thresholds.special_case_share * candidate.gain
    ]
    if not special:
        return not_asked(name, "more than its special cases predict: none of these gains enough")
    best = max(special, key=lambda each: each.validation_gains.sum())
    what = f"gain in validation episodes beside its special case {best.name}"
    own, other = float(candidate.validation_gains.sum()), float(best.validation_gains.sum())
    return compare(name, what, own, Direction.AT_LEAST, other, because=", which that one gains")


def rivals_the_best(candidate: RefittedEffect, best: RefittedEffect, thresholds: Thresholds) -> CriterionResult:
    """It explains about as much as the best candidate, and is as constant; else it is not named beside it."""
    if _differs(candidate, best):
        sentence = f"it is asked for in another size in each motion, where {best.name} is the same in all"
        return state("rivals_the_best", sentence, passed=False)
    needed, gain = needed_to_rival(candidate, best, thresholds), penalised_gain(candidate, thresholds)
    because = f" to rival {best.name} with {penalised_gain(best, thresholds):.0f}"
    return compare("rivals_the_best", "penalised gain", gain, Direction.AT_LEAST, needed, because=because)


def told_apart(best: RefittedEffect, near: Sequence[RefittedEffect], thresholds: Thresholds) -> CriterionResult:
    """No other supported candidate explains about as much as the best one.

    Args:
        near: the candidates that do.
    """
    name = "told_apart"
    if not near:
        return not_asked(name, "penalised gain of others: none explains about as much")
    other = max(near, key=lambda each: penalised_gain(each, thresholds))
    gain, most = penalised_gain(other, thresholds), needed_to_rival(other, best, thresholds)
    because = f" to be told apart from {best.name} with {penalised_gain(best, thresholds):.0f}"
    return compare(name, f"penalised gain of {other.name}", gain, Direction.BELOW, most, because=because)


def has_no_equivalent(best: RefittedEffect) -> CriterionResult:
    """It is not one thing with another effect of the library."""
    name, traits = "has_no_equivalent", effect_named(best.name).traits
    if not is_horizontal(best):
        return not_asked(name, "other names of the same thing: there are none")
    return state(name, f"a horizontal one is the same thing as {', '.join(traits.equivalent_to)}", passed=False)


def is_horizontal(candidate: RefittedEffect) -> bool:
    """Whether an effect is a steady force to the side, or what is the same."""
    return effect_named(candidate.name).traits.is_horizontal(candidate.values)


def is_outdone(candidate: RefittedEffect, good: Sequence[RefittedEffect], thresholds: Thresholds) -> bool:
    """Whether a candidate is no rival of the first of those that are good: it explains clearly less, or it is another
    one in each motion while the first is the same in all."""
    differs = any(candidate is each for each in good) and _differs(candidate, good[0])
    return differs or explains_less(candidate, good[0], thresholds)


def _differs(candidate: RefittedEffect, best: RefittedEffect) -> bool:
    """Whether only the best one is asked for in the same size by every episode."""
    return best.episodes_agree and not candidate.episodes_agree
