"""The criteria that every refitted candidate is held against, one function each; the table is at the end."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.diagnosis.criterion import CriterionResult, Direction, compare, not_asked, state
from egophys_core.diagnosis.evidence.judging import RefittedEffect
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.verdict.penalised_gain import complexity_penalty
from egophys_core.effects import effect_named
from egophys_core.effects.traits import never
from egophys_core.kinds import kind_of


@dataclass(frozen=True, kw_only=True)
class Setting:
    """In what a candidate is tested."""

    thresholds: Thresholds
    surrogate_shares: Mapping[str, float]
    """Per effect the share of surrogates that gain as much."""
    beside_named: bool
    """Whether it would be named beside another effect."""
    free_residual_m: float | None
    """Metres that free rollouts leave without an effect; None where observers follow the episodes."""
    others: Sequence[RefittedEffect] = ()
    """Candidates that neither validation episodes nor other twins speak against, `SUPPORT`."""


Criterion = Callable[[RefittedEffect, Setting], CriterionResult]


def explains_free_rollouts(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """It leaves clearly less than a free rollout leaves without it, or no more than a twin's own mismatch."""
    name = "explains_free_rollouts"
    if setting.free_residual_m is None:
        return not_asked(name, "residuals of free rollouts: not asked of what observers follow")
    most = max(setting.thresholds.floor_m, setting.thresholds.left_share * setting.free_residual_m)
    because = f" where {1e3 * setting.free_residual_m:.1f} mm are left without it"
    return compare(name, "it leaves", 1e3 * candidate.left_m, Direction.AT_MOST, 1e3 * most, unit="mm", because=because)


def not_only_deflection(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """It says more than that a toy's static deflection is not its twin's.

    How firmly a toy is gripped, how stiff it is and how much it weighs are one thing there: every recorded and
    rehearsed toy asks for an upward force of 1.6 to 2.9 m/s^2, also those that lack nothing.
    """
    name, is_vertical = "not_only_deflection", effect_named(candidate.name).traits.is_vertical
    if is_vertical is never or kind_of(candidate.fitted.model).static_deflection_is_evidence:
        return not_asked(name, "more than the static deflection of a toy: not asked of this effect in this object")
    only = is_vertical(candidate.values)
    says = "only of its static deflection, which" if only else "of more than its static deflection, which alone"
    return state(name, f"it speaks {says} is no evidence in a toy", passed=not only)


def held_out_gain(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """It gains enough on left-out stretches of time, by how it stands among others and how it could be validated."""
    alone, why = _asked_gain(candidate, setting)
    penalty = complexity_penalty(candidate, setting.thresholds)
    needed = max(setting.thresholds.least_gain, alone + penalty)
    if penalty:
        why += f" and {penalty:.0f} are for its {len(candidate.parameters)} parameters"
    if setting.beside_named and needed < setting.thresholds.second_gain:
        needed, why = setting.thresholds.second_gain, " beside an effect that is named"
    return compare(
        "held_out_gain", "gain on left-out data", candidate.gain, Direction.AT_LEAST, needed, because=f",{why}"
    )


def _asked_gain(candidate: RefittedEffect, setting: Setting) -> tuple[float, str]:
    """The gain that is asked for before any penalty, and why."""
    thresholds = setting.thresholds
    if len(candidate.validation_gains):
        alike = {candidate.name, *candidate.confounders}
        crowd = [
            each
            for each in setting.others
            if each.name not in alike
            and each.gain > thresholds.crowd_share * candidate.gain
            and not is_refuted(each, thresholds)
        ]
        if crowd:
            names = ", ".join(each.name for each in crowd)
            return thresholds.crowded_gain, f" beside {names}, which gain more than half as much"
        return thresholds.least_gain, " as it stands alone"
    left_out = candidate.episode_gains
    if len(left_out) >= thresholds.episodes_in_turn and bool((left_out > 0.0).all()):
        return thresholds.in_turn_gain, " as it gains in each of the motions when that is left out"
    return thresholds.unvalidated_gain, " as no validation episode would show it"


def gain_interval(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """Over resampled blocks of time it hardly ever loses."""
    low, what = candidate.gain_ci95[0], "lower end of the 95 % interval of the gain"
    return compare("gain_interval", what, low, Direction.ABOVE, 0.0)


def surrogates(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """Few surrogates, slopes that are shifted in time, gain as much."""
    share, most = setting.surrogate_shares[candidate.name], setting.thresholds.largest_p
    return compare("surrogates", "share of surrogates that gain as much", share, Direction.AT_MOST, most, unit="1")


def validation(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """It gains in the episodes that took no part in the fit, too."""
    name = "validation"
    if not len(candidate.validation_gains):
        return not_asked(name, "gain in validation episodes: there are none in which it would show")
    if effect_named(candidate.name).traits.is_event:
        return not_asked(name, "gain in validation episodes: not asked of what happens in some episodes only")
    thresholds = setting.thresholds
    needed = min(thresholds.supported_share * candidate.gain, thresholds.supporting_gain)
    if candidate.gain >= thresholds.overwhelming_gain:
        needed = -thresholds.supporting_gain
    found = float(candidate.validation_gains.sum())
    return compare(name, "gain in validation episodes", found, Direction.ABOVE, needed)


def differs_from_none(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """The interval of some size leaves out the value at which the effect vanishes."""
    found = -np.inf
    for each in effect_named(candidate.name).parameters:
        if each.null is not None:
            low, high = candidate.parameters[each.name].ci95
            found = max(found, (low - each.null) / each.step, (each.null - high) / each.step)
    what = "a size's 95 % interval is off no effect by"
    return compare("differs_from_none", what, found, Direction.ABOVE, 0.0, unit="steps")


def within_bounds(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """No size or scale ended at the end of its range: that is no physics, but something else taking its part."""
    scale = effect_named(candidate.name).traits.degenerate_parameter
    parameters = effect_named(candidate.name).parameters
    at_bound = [
        each.name
        for each in parameters
        if (each.null is not None or each.name == scale)
        and any(candidate.values[each.name] == bound != each.null for bound in (each.low, each.high))
    ]
    what = f"parameters that ended at a bound{': ' + ', '.join(at_bound) + ',' if at_bound else ':'}"
    return compare("within_bounds", what, len(at_bound), Direction.AT_MOST, 0, unit="1")


def plausible(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """Its values are of such an effect: an added mass lies where the object is.

    In a rehearsed box without an effect one 0.7 m above it gained 172.
    """
    name, is_implausible = "plausible", effect_named(candidate.name).traits.is_implausible
    if is_implausible is never:
        return not_asked(name, "plausible values: all within the bounds are")
    odd = is_implausible(candidate.values, candidate.fitted.model.graph.positions)
    return state(name, f"its values are {'not ' if odd else ''}of such a thing in this object", passed=not odd)


def left_out_episodes(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """Enough of the gain remains where each episode is left out as a whole."""
    name, gains = "left_out_episodes", candidate.episode_gains[~np.isnan(candidate.episode_gains)]
    if not len(gains):
        return not_asked(name, "gain in episodes left out as a whole: there is one episode only")
    if is_validated_in_full(candidate):
        return not_asked(name, "gain in episodes left out as a whole: not asked, as validation episodes gain as much")
    needed = setting.thresholds.remaining_share * candidate.gain
    what = "gain in episodes left out as a whole"
    return compare(name, what, float(gains.sum()), Direction.ABOVE, needed)


def same_size(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """What is the same in every motion is not asked for in sizes of which one makes another motion clearly worse."""
    name, what = "same_size", "least gain of an episode by the size that the others ask for"
    if not effect_named(candidate.name).traits.same_in_every_motion:
        return not_asked(name, f"{what}: not asked of what may differ between motions")
    if candidate.episodes_agree or is_validated_in_full(candidate):
        why = "the episodes agree" if candidate.episodes_agree else "validation episodes gain as much"
        return not_asked(name, f"{what}: not asked, as {why}")
    if np.isnan(candidate.episode_gains).all():
        return not_asked(name, f"{what}: there is one episode only")
    needed = -setting.thresholds.harm_share * candidate.gain
    return compare(name, what, float(np.nanmin(candidate.episode_gains)), Direction.AT_LEAST, needed)


def every_episode(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """Beside a named effect, whose baseline is mismatch for the most part, it helps in every episode that is left out.

    A toy that slips asked for an added mass besides with a gain of 216, which made one of its episodes worse.
    """
    name, what = "every_episode", "least gain of an episode left out as a whole"
    if not setting.beside_named:
        return not_asked(name, f"{what}: asked beside a named effect only")
    least = float(candidate.episode_gains.min())
    if np.isnan(least):
        return state(name, f"{what}: there is one episode only", passed=False)
    return compare(name, what, least, Direction.ABOVE, 0.0)


def predicts(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """Beside a named effect, the recordings are predicted better with it: planning has no observer to make up for it.

    In a sheet with drag alone a friction that differs by place gained 88, and left 1.1 of these errors.
    """
    name, what = "predicts", "mean share of the track errors of free rollouts that it leaves"
    if candidate.shares_left is None:
        return not_asked(name, f"{what}: asked of what gains enough beside a named effect only")
    share = float(np.exp(np.log(np.maximum(candidate.shares_left, np.finfo(float).tiny)).mean()))
    return compare(name, what, share, Direction.BELOW, setting.thresholds.predicting_share, unit="1")


def other_twins(candidate: RefittedEffect, setting: Setting) -> CriterionResult:
    """It gains beside twins of other graphs and grasps, too: what makes up for how one is made does not."""
    name, what = "other_twins", "least share of its gain that it gains beside other graphs and grasps"
    gains = candidate.gains_beside_others
    if gains is None or not len(gains):
        return not_asked(name, f"{what}: asked of what would be named, where there are others")
    share = float(gains.min()) / candidate.gain
    return compare(name, what, share, Direction.AT_LEAST, setting.thresholds.others_share, unit="1")


def is_validated_in_full(candidate: RefittedEffect) -> bool:
    """Whether it gains as much in episodes that took no part in the fit as in those that did.

    Then these need not support it, each by the size that the others ask for: that of a cable's small motion may be none
    for its large one (an injected drag gained 189, 247 in a third motion, and -359 in the large one that way).
    """
    return len(candidate.validation_gains) > 0 and float(candidate.validation_gains.sum()) >= candidate.gain


def is_refuted(candidate: RefittedEffect, thresholds: Thresholds) -> bool:
    """Whether the size that the other episodes ask for makes one clearly worse; one that shows little of it may not."""
    return bool((candidate.episode_gains < -thresholds.harm_share * candidate.gain).any())


SCREENS: tuple[Criterion, ...] = (explains_free_rollouts, not_only_deflection)
"""What fails one of these is no candidate: it counts for nothing, not even against others."""

SUPPORT: tuple[Criterion, ...] = (validation, other_twins)
"""What passes these is supported by what it was not fitted to; what does not is no rival of others, and no sign of
structure."""

CRITERIA: tuple[Criterion, ...] = (
    held_out_gain,
    gain_interval,
    surrogates,
    validation,
    differs_from_none,
    within_bounds,
    plausible,
    left_out_episodes,
    same_size,
    every_episode,
    predicts,
    other_twins,
)
"""What passes all of these may be named."""
