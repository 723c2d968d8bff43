"""The rules that make an outcome of how candidates stand, in the order in which they are asked; the first decides."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from egophys_core.diagnosis.criterion import CriterionResult, Direction, compare
from egophys_core.diagnosis.diagnosis import NearestMiss, Outcome
from egophys_core.diagnosis.evidence.judging import RefittedEffect
from egophys_core.diagnosis.thresholds import STRUCTURED
from egophys_core.diagnosis.verdict.comparison import has_no_equivalent, is_horizontal, told_apart
from egophys_core.diagnosis.verdict.criteria import Setting, held_out_gain
from egophys_core.diagnosis.verdict.penalised_gain import complexity_penalty
from egophys_core.effects import effect_named

ANOTHER_MOTION = "record one more motion, and give it last: it is not fitted, and what is named has to show there, too"

A_SECOND_MOTION = (
    "record a second motion of the object (a lift, if this is a pull; `egophys experiment TWIN --diagnosis DIR` says "
    "which shows most) and give both: one motion alone cannot tell what the twin lacks from what it was bent to make "
    "up for"
)


@dataclass(frozen=True, kw_only=True)
class Standing:
    """How the candidates stand that pass on their own, and what stands beside them."""

    good: tuple[RefittedEffect, ...]
    """Those that pass all of their criteria, the best first."""
    rivals: tuple[RefittedEffect, ...]
    """Those that cannot be told apart from the best."""
    refuted_rivals: tuple[RefittedEffect, ...]
    """Where there are no rivals: those that explain as much as the best, but fail a criterion."""


@dataclass(frozen=True, kw_only=True)
class Situation:
    """All that an outcome depends on."""

    setting: Setting
    ordered: Sequence[RefittedEffect]
    """The candidates, by falling penalised gain."""
    supported: Sequence[RefittedEffect]
    """Those of them that neither validation episodes nor other twins speak against."""
    standing: Standing
    nearest_misses: tuple[NearestMiss, ...]
    law_gain: float
    episodes: int
    residual_m: float

    @property
    def names_nothing(self) -> bool:
        """Whether no candidate passes, or only one that gains little and that a refuted one explains as well."""
        standing, structure_gain = self.standing, self.setting.thresholds.structure_gain
        if not standing.good:
            return True
        return bool(standing.refuted_rivals) and standing.good[0].gain < structure_gain


@dataclass(frozen=True, kw_only=True)
class Ruling:
    """What a rule says."""

    outcome: Outcome
    named: tuple[RefittedEffect, ...] = ()
    candidate: str | None
    """Whose criterion decided; None where it is of no candidate."""
    criterion: CriterionResult
    """What decided."""
    reason: str
    experiment: str | None


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One rule of the table."""

    name: str
    sentence: str
    """When it applies, and what it makes of that."""
    apply: Callable[[Situation], Ruling | None]


def large_residual(situation: Situation) -> Ruling | None:
    """Residuals that are larger than those of a twin that lacks nothing."""
    floor_m = situation.setting.thresholds.floor_m
    if not situation.names_nothing or situation.residual_m <= floor_m:
        return None
    reason = (
        f"residuals of {1e3 * situation.residual_m:.1f} mm, where a twin that lacks nothing leaves "
        f"{1e3 * floor_m:.0f} at most, and no effect of the library explains them"
    )
    found, most = 1e3 * situation.residual_m, 1e3 * floor_m
    return _nothing_named(
        situation,
        outcome=Outcome.UNEXPLAINED,
        candidate=None,
        criterion=compare("residual_size", "median residual", found, Direction.AT_MOST, most, unit="mm"),
        reason=reason,
        experiment=None,
    )


def unexplained_structure(situation: Situation) -> Ruling | None:
    """A gain that is more than a twin's own mismatch gains."""
    criterion = _structure(situation)
    if not situation.names_nothing or criterion.passed:
        return None
    reason = (
        f"the residual has structure (a gain of {criterion.statistic:.0f}, where 1 in {STRUCTURED} sets that lack "
        f"nothing gains {situation.setting.thresholds.structure_gain:.0f}), but no effect of the library passes all "
        "criteria"
    )
    validated = any(len(each.validation_gains) for each in situation.supported)
    return _nothing_named(
        situation,
        outcome=Outcome.UNEXPLAINED,
        candidate=None,
        criterion=criterion,
        reason=reason,
        experiment=None if validated else ANOTHER_MOTION,
    )


def no_candidate_passes(situation: Situation) -> Ruling | None:
    """Nothing that is more than noise and mismatch."""
    if not situation.names_nothing:
        return None
    thresholds, misses = situation.setting.thresholds, situation.nearest_misses
    best = max([situation.law_gain, *(each.gain for each in situation.ordered)])
    return _nothing_named(
        situation,
        outcome=Outcome.NONE,
        candidate=misses[0].candidate if misses else None,
        criterion=misses[0].failed[0] if misses else _structure(situation),
        reason=f"what gains most on held-out data gains {max(best, 0.0):.0f}; 1 in {STRUCTURED} sets that lack nothing "
        f"gains {thresholds.structure_gain:.0f}, and an effect that stands alone needs {thresholds.least_gain:.0f} and "
        "to pass all criteria",
        experiment=None,
    )


def refuted_rival(situation: Situation) -> Ruling | None:
    """What a candidate that fails a criterion explains as well."""
    refuted = situation.standing.refuted_rivals
    if not refuted:
        return None
    best = situation.standing.good[0]
    alike = ", ".join(each.name for each in refuted)
    return Ruling(
        outcome=Outcome.UNEXPLAINED,
        candidate=best.name,
        criterion=told_apart(best, refuted, situation.setting.thresholds),
        reason=f"{best.name} gains {best.gain:.0f}, but {alike} gains about as much and is refuted: what they share is "
        "no evidence for either",
        experiment=experiment_for(best.name, situation.episodes < 2),
    )


def indistinguishable_rivals(situation: Situation) -> Ruling | None:
    """Several that explain about as much."""
    rivals = situation.standing.rivals
    if not rivals:
        return None
    best = situation.standing.good[0]
    criterion = told_apart(best, rivals, situation.setting.thresholds)
    return _ambiguous(
        situation,
        criterion=has_no_equivalent(best) if criterion.passed else criterion,
        reason=f"{', '.join(each.name for each in (best, *rivals))} explain the residual about equally well",
    )


def one_motion_only(situation: Situation) -> Ruling | None:
    """What one motion alone asks for."""
    if situation.episodes >= 2:
        return None
    return _ambiguous(
        situation,
        criterion=compare("motions", "motions fitted:", situation.episodes, Direction.AT_LEAST, 2, unit="1"),
        reason=f"{situation.standing.good[0].name} explains the residual, but of one motion only",
    )


def equivalent_effect(situation: Situation) -> Ruling | None:
    """What has two names."""
    best = situation.standing.good[0]
    if not is_horizontal(best):
        return None
    others = ", ".join(effect_named(best.name).traits.equivalent_to)
    return _ambiguous(
        situation,
        criterion=has_no_equivalent(best),
        reason=f"{best.name} explains the residual, and so would {others}",
    )


def named(situation: Situation) -> Ruling | None:
    """What stands alone."""
    best, thresholds = situation.standing.good[0], situation.setting.thresholds
    return Ruling(
        outcome=Outcome.NAMED,
        named=(best,),
        candidate=best.name,
        criterion=held_out_gain(best, situation.setting),
        reason=f"{best.name} gains {best.gain:.0f} on held-out data "
        f"(95 %: {best.gain_ci95[0]:.0f} to {best.gain_ci95[1]:.0f}), where at most {thresholds.largest_p:.0%} of "
        "surrogates gain as much, and clearly more than any other effect",
        experiment=None,
    )


RULES = (
    Rule(
        name="large_residual",
        sentence="No effect is named, and residuals are larger than those of a twin that lacks nothing: unexplained.",
        apply=large_residual,
    ),
    Rule(
        name="unexplained_structure",
        sentence="No effect is named, but more is gained than a twin's own mismatch gains: unexplained.",
        apply=unexplained_structure,
    ),
    Rule(
        name="no_candidate_passes",
        sentence="No candidate passes all criteria, and none gains more than a twin's own mismatch does: no effect.",
        apply=no_candidate_passes,
    ),
    Rule(
        name="refuted_rival",
        sentence="A candidate passes, but one that fails explains as much: what they share is evidence for neither.",
        apply=refuted_rival,
    ),
    Rule(
        name="indistinguishable_rivals",
        sentence="Several candidates pass and explain about as much, or are one thing: ambiguous.",
        apply=indistinguishable_rivals,
    ),
    Rule(
        name="one_motion_only",
        sentence="A candidate passes, but one motion does not tell the object from the motion: ambiguous.",
        apply=one_motion_only,
    ),
    Rule(
        name="equivalent_effect",
        sentence="A candidate passes that is one thing with another effect of the library: ambiguous.",
        apply=equivalent_effect,
    ),
    Rule(
        name="named",
        sentence="One candidate passes all criteria and explains clearly more than any other: it is named.",
        apply=named,
    ),
)
"""The first that applies decides; the last always does."""


def first_ruling(situation: Situation) -> tuple[Rule, Ruling]:
    """The first rule that applies, and what it says."""
    return next((rule, ruling) for rule in RULES if (ruling := rule.apply(situation)))


def experiment_for(name: str, one_motion: bool) -> str:
    """What to do next to tell an effect from its confounders."""
    traits = effect_named(name).traits
    more = "record a second episode of another motion; then " if one_motion else ""
    return f"{more}{traits.experiment} (tells {name} from {', '.join(traits.confounders)})"


def _structure(situation: Situation) -> CriterionResult:
    """What is gained by a generic law, or by effects that few surrogates match, is no more than mismatch gains."""
    setting = situation.setting
    gains = [
        each.gain - complexity_penalty(each, setting.thresholds)
        for each in situation.supported
        if setting.surrogate_shares[each.name] <= setting.thresholds.largest_p
    ]
    most = setting.thresholds.structure_gain
    if setting.beside_named:
        most = max(most, setting.thresholds.second_gain)
    what = "largest gain of a generic force law or an effect that is not named, less its complexity penalty,"
    return compare("structure", what, max([situation.law_gain, *gains]), Direction.BELOW, most)


def _nothing_named(
    situation: Situation,
    *,
    outcome: Outcome,
    candidate: str | None,
    criterion: CriterionResult,
    reason: str,
    experiment: str | None,
) -> Ruling:
    """A ruling that names no effect; of one motion it could not."""
    one_motion = situation.episodes < 2
    return Ruling(
        outcome=outcome,
        candidate=candidate,
        criterion=criterion,
        reason=f"of one motion nothing can be named: {reason}" if one_motion else reason,
        experiment=A_SECOND_MOTION if one_motion else experiment,
    )


def _ambiguous(situation: Situation, *, criterion: CriterionResult, reason: str) -> Ruling:
    """A ruling that names the best candidate and its rivals."""
    best = situation.standing.good[0]
    return Ruling(
        outcome=Outcome.AMBIGUOUS,
        named=(best, *situation.standing.rivals),
        candidate=best.name,
        criterion=criterion,
        reason=reason,
        experiment=experiment_for(best.name, situation.episodes < 2),
    )
