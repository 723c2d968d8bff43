"""The verdict: from judged effects to one outcome. All thresholds of the diagnosis are here.

A twin is never right, and what it lacks anyway is soaked up by some effects of the library, several of them alike; what
gains no more than that is no evidence (docs/notes/discrepancy.md). A true effect stands alone, but for what mimics it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.diagnosis.diagnosis import Outcome
from egophys_core.diagnosis.evidence.judging import Judged, interval_of_sum
from egophys_core.effects import effect_named
from egophys_core.effects.uneven_mass import lies_beside
from egophys_core.kinds import kind_of

LEAST_GAIN = 50.0
"""Gain in log-likelihood that an effect must reach to be named if it stands alone."""

CROWDED_GAIN = 60.0
"""Gain it must reach beside others that gain more than half as much."""

FEW_PARAMETERS, PARAMETER_GAIN = 2, 5.0
"""Each number of an effect beyond so many asks for so much more: what has a place, a time and a direction soaks up more
of a mismatch (a force to and fro gained 80 in a towel without an effect that was pulled over the table)."""

SECOND_GAIN = 80.0
"""Gain that an effect, or a structure, must reach beside a named one: what is left then is mismatch for the most part
(a toy whose lump was named asked for a tether besides, with a gain of 79; one that slips, for a lump, with 216, which
made one of its episodes worse). So it must help in every episode that is left out, too."""

UNPROVEN_GAIN = 90.0
"""Gain that an effect must reach where no episode is left that could bear it out: in two motions alone rehearsed sets
gained 65 for a gripper offset that was not there, 82 for a tracking offset and 86 for rough places in sheets that
lacked something else."""

BY_TURNS, BY_TURNS_GAIN = 3, 75.0
"""So many fitted motions, each of which gains by an effect when it is left out as a whole, come near to a proof, and
this is asked for: the lump of `plush_lump` gained 34, 18 and 18 (100 over left-out stretches); a false offset of the
hands in `towel_drag` 78 there."""

ANOTHER_MOTION = "record one more motion, and give it last: it is not fitted, and what is named has to show there, too"

A_SECOND_MOTION = (
    "record a second motion of the object (a lift, if this is a pull) and give both: one motion alone cannot tell what "
    "the twin lacks from what it was bent to make up for"
)

CROWD = 0.5
"""Share of an effect's gain from which another, which does not mimic it and is not disproven, makes a crowd."""

REMAINS = 0.2
"""Share of an effect's gain that must remain where each episode is left out as a whole."""

LARGEST_P = 0.05
"""Share of shams that may gain as much."""

RIVAL, EQUAL = 0.75, 0.9
"""An effect with `EQUAL` of the best one's evidence is not told apart from it; one with `RIVAL` of it is if the
difference, over blocks of time, may be chance."""

PROOF_SHARE = 0.5
"""Share of an effect's gain by which episodes that were not fitted may raise or lower the evidence for it: of a planted
drag, a tether and a place with rougher friction, which gained 69, 70 and 73, they gained 34, 2 and 14."""

LESSER = 0.4
"""Share of a general effect's gain from which a special case is kept in its place if it predicts more of what was not
fitted."""

RESAMPLES = 500
"""Of the blocks, for that difference."""

REFUTED = 0.2
"""Share of an effect's gain that an episode, left out, may lose with it."""

FLOOR_M = 0.002
"""Metres: median residual from which a twin lacks something, whatever it may be; those without an effect left 0.5 to
1.3 mm, a sheet under a force to and fro 3.2."""

MOST_LEFT = 0.7
"""Share of what a free rollout misses that an effect may leave where that is beyond `FLOOR_M`. A cable that a thread
held was said to feel a steady force of 8 m/s^2, which left 33 mm of 38."""

PROVEN, PROOF_GAIN = 0.1, 15.0
"""Share of an effect's gain that it must gain in episodes that took no part in the fit, where there are any, and the
gain there that is enough in any case: a tether that pulled in two motions was slack for the most part of the third."""

STRUCTURE_GAIN = 70.0
"""Held-out gain of a generic law, or of an effect that is not accepted, from which a residual is called structured."""


OF_THE_SURROUNDINGS = (
    "quadratic_drag",
    "constant_body_force",
    "gravity_scale",
    "gravity_tilt",
    "point_attraction",
    "control_delay",
    "tracking_scale",
    "tracking_rotation",
)
"""Effects that are the same in every motion: episodes that ask for different sizes, of which one makes the other
worse, refute them. A lump's place and size make up for each other, and a grip slips as it was taken."""


SPECIAL_CASES = {
    "constant_body_force": ("gravity_tilt", "gravity_scale"),
    "time_varying_body_force": ("constant_body_force", "gravity_tilt", "gravity_scale"),
    "point_attraction": ("constant_body_force", "gravity_tilt", "gravity_scale"),
}
"""Effects that another one contains, or comes near to. That the special case is refuted says nothing against the
general one, nor the other way round; of both the special one is named, unless the general one explains clearly more."""

THE_SAME = {"constant_body_force", "gravity_tilt"}
"""A horizontal force and tilted gravity are one thing: neither is the simpler."""

SCALES = {"viscoelasticity": "time", "hysteresis": "strain"}
"""Numbers at whose ends an effect is no longer itself: what relaxes at once is a damper, which a twin has, and what
yields at once rubs. A cable whose bending is damped, as a lattice's is not, gained 1072 for relaxation in 0.03 s."""

EVENTS = ("grasp_slip",)
"""Effects that happen or not: a grip that slips in some episodes need not slip in others."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """An outcome and what it rests on."""

    outcome: Outcome
    judged: tuple[Judged, ...]
    """The effect named, or those that cannot be told apart; the best first."""
    reason: str
    experiment: str | None


def acceptable(judged: Judged, p_null: float) -> bool:
    """Whether an effect stands on its own: beyond chance and mismatch, in both senses of held out, and physical."""
    return (
        judged.gain >= LEAST_GAIN
        and judged.gain_ci95[0] > 0.0
        and p_null <= LARGEST_P
        and not disproven(judged)
        and differs_from_null(judged)
        and not at_bound(judged)
        and not off_the_object(judged)
        and (borne_out(judged) or (remains(judged) and not contradicted(judged)))
    )


def borne_out(judged: Judged) -> bool:
    """Whether it gains as much in episodes that took no part in the fit as in those that did.

    Then these need not bear it out, each by the size that the others ask for: that of a cable's small motion may be
    none for its large one (a planted drag gained 189, 247 in a third motion, and -359 in the large one that way).
    """
    return len(judged.proof_gains) > 0 and float(judged.proof_gains.sum()) >= judged.gain


def explaining(judged: Sequence[Judged], missed_m: float) -> list[Judged]:
    """Those that leave clearly less than a free rollout misses without them, or no more than a twin's own mismatch."""
    return [each for each in judged if each.left_m <= max(FLOOR_M, MOST_LEFT * missed_m)]


def remains(judged: Judged) -> bool:
    """Whether enough of the gain remains where each episode is left out as a whole, if there are several."""
    left_out = judged.episode_gains[~np.isnan(judged.episode_gains)]
    return len(left_out) == 0 or float(left_out.sum()) > REMAINS * judged.gain


def contradicted(judged: Judged) -> bool:
    """Whether what is the same in every motion is asked for in different sizes, and one makes another clearly worse."""
    return judged.name in OF_THE_SURROUNDINGS and not judged.episodes_agree and refuted(judged)


def refuted(judged: Judged) -> bool:
    """Whether the size that the other episodes ask for makes one clearly worse; one that shows little of it may not."""
    return bool((judged.episode_gains < -REFUTED * judged.gain).any())


def disproven(judged: Judged) -> bool:
    """Whether the episodes that took no part in the fit say nothing for it, or speak against it."""
    if not len(judged.proof_gains) or judged.name in EVENTS:
        return False
    return float(judged.proof_gains.sum()) <= min(PROVEN * judged.gain, PROOF_GAIN)


def needed(judged: Judged, others: Sequence[Judged]) -> float:
    """The gain that an effect needs beside others."""
    alike = {judged.name, *judged.mimics}
    crowd = [each for each in others if each.name not in alike and each.gain > CROWD * judged.gain]
    alone = CROWDED_GAIN if any(not refuted(each) for each in crowd) else LEAST_GAIN
    return (alone if len(judged.proof_gains) else _unproven_gain(judged)) + freedom(judged)


def _unproven_gain(judged: Judged) -> float:
    """The gain that an effect needs where no episode is left that could bear it out."""
    by_turns = len(judged.episode_gains) >= BY_TURNS and bool((judged.episode_gains > 0.0).all())
    return BY_TURNS_GAIN if by_turns else UNPROVEN_GAIN


def freedom(judged: Judged) -> float:
    """The gain that an effect's many numbers are asked for."""
    return PARAMETER_GAIN * max(0, len(judged.parameters) - FEW_PARAMETERS)


def evidence(judged: Judged) -> float:
    """What speaks for an effect beside others: its gain, less what its many numbers are asked for, and its proof."""
    most = PROOF_SHARE * abs(judged.gain)
    return judged.gain - freedom(judged) + float(np.clip(judged.proof_gains.sum(), -most, most))


def kin(name: str) -> set[str]:
    """Effects that one contains, or that contain it."""
    return {*SPECIAL_CASES.get(name, ()), *(other for other, special in SPECIAL_CASES.items() if name in special)}


def beaten(judged: Judged, best: Judged) -> bool:
    """Whether an effect explains clearly less than the best."""
    if evidence(judged) < RIVAL * evidence(best):
        return True
    low, _ = interval_of_sum(best.block_gains - judged.block_gains, RESAMPLES, seed=0)
    return evidence(judged) < EQUAL * evidence(best) and low > 0.0


def outdone(judged: Judged, good: Sequence[Judged]) -> bool:
    """Whether an effect is no rival of the first of those that are good: it explains clearly less, or it is another one
    in each motion while the first is the same in all."""
    fickle = good[0].episodes_agree and not judged.episodes_agree and any(judged is each for each in good)
    return fickle or beaten(judged, good[0])


def needless(judged: Judged, good: Sequence[Judged], likely: Sequence[Judged]) -> bool:
    """Whether a special case of an effect explains about as much, or predicts more of what was not fitted."""
    special = {name for name in SPECIAL_CASES.get(judged.name, ()) if {judged.name, name} != THE_SAME}
    return any(not beaten(each, judged) for each in good if each.name in special) or any(
        each.proof_gains.sum() > judged.proof_gains.sum() and each.gain >= LESSER * judged.gain
        for each in likely
        if each.name in special
    )


def level(judged: Judged) -> bool:
    """Whether an effect is a steady force to the side, or the tilt that is the same."""
    if judged.name == "constant_body_force":
        return bool(np.hypot(judged.values["x"], judged.values["y"]) > abs(judged.values["z"]))
    return judged.name in THE_SAME


def differs_from_null(judged: Judged) -> bool:
    """Whether the interval of some size leaves out the value at which the effect vanishes."""
    sizes = [each for each in effect_named(judged.name).parameters if each.null is not None]
    intervals = [(judged.parameters[each.name].ci95, each.null) for each in sizes]
    return any(null < low or null > high for (low, high), null in intervals if null is not None)


def at_bound(judged: Judged) -> bool:
    """Whether a size or a scale ended at the end of its range: no physics, but something else taking its part."""
    for parameter in effect_named(judged.name).parameters:
        if parameter.null is None and parameter.name != SCALES.get(judged.name):
            continue
        value = judged.parameters[parameter.name].value
        for bound in (parameter.low, parameter.high):
            if value == bound and bound != parameter.null:
                return True
    return False


def off_the_object(judged: Judged) -> bool:
    """Whether a lump lies where nothing of the object is: no lump, but mass that slopes all over it.

    In a rehearsed box without an effect one 0.7 m above it gained 172.
    """
    return judged.name == "uneven_mass" and lies_beside(judged.values, judged.fitted.model.graph.positions)


def sags(judged: Judged) -> bool:
    """Whether an effect says only that a toy sags less or more than its twin.

    How firmly it is gripped, how stiff it is and how much it weighs are one thing there: every recorded and rehearsed
    toy asks for an upward force of 1.6 to 2.9 m/s^2, also those that lack nothing (docs/notes/discrepancy.md).
    """
    if judged.name not in ("gravity_scale", "constant_body_force") or kind_of(judged.fitted.model).sag_is_evidence:
        return False
    force = judged.values
    return judged.name == "gravity_scale" or abs(force["z"]) > np.hypot(force["x"], force["y"])


def decide(
    judged: Sequence[Judged],
    p_null: dict[str, float],
    law_gain: float,
    episodes: int,
    *,
    second: bool = False,
    residual_m: float = 0.0,
) -> Verdict:
    """One outcome for the effects judged, of which none or several may be acceptable.

    Args:
        second: whether they would be named beside another effect.
        p_null: per effect the share of shams that gain as much.
        law_gain: held-out gain of the best generic law, 0 if shams gain as much.
        residual_m: median size of the residuals without an effect.
        episodes: how many were fitted; one cannot show that an effect is the object's and not the motion's.
    """
    ordered = sorted((each for each in judged if not sags(each)), key=evidence, reverse=True)
    least = SECOND_GAIN if second else 0.0
    likely = [each for each in ordered if not disproven(each)]
    good = [
        each
        for each in ordered
        if acceptable(each, p_null[each.name])
        and each.gain >= max(least, needed(each, likely))
        and (not second or bool((each.episode_gains > 0.0).all()))
    ]
    good = [each for each in good if not needless(each, good, likely)]
    near = [each for each in likely if good and each is not good[0] and not outdone(each, good)]
    rivals = [each for each in near if any(each is other for other in good)]
    if good and level(good[0]):
        # One thing under two names: that one's refit ended worse, or fails a test, says nothing of which it is.
        rivals += [each for each in ordered if level(each) and not any(each is other for other in (good[0], *rivals))]
    near = [each for each in near if each.name not in kin(good[0].name)]
    if not good or (near and not rivals and good[0].gain < STRUCTURE_GAIN):
        # What shams gain as well is no structure.
        structure = max([law_gain, *(each.gain - freedom(each) for each in likely if p_null[each.name] <= LARGEST_P)])
        outcome, next_step = Outcome.UNEXPLAINED, None
        if residual_m > FLOOR_M:
            reason = (
                f"residuals of {1e3 * residual_m:.1f} mm, where a twin that lacks nothing leaves "
                f"{1e3 * FLOOR_M:.0f} at most, and no effect of the library explains them"
            )
        elif structure >= max(STRUCTURE_GAIN, least):
            reason = (
                f"the residual has structure (a gain of {structure:.0f} where a twin's own mismatch reaches "
                f"{CROWDED_GAIN:.0f}), but no effect of the library passes all tests"
            )
            next_step = None if any(len(each.proof_gains) for each in likely) else ANOTHER_MOTION
        else:
            outcome = Outcome.NONE
            best = max([law_gain, *(each.gain for each in ordered)])
            reason = (
                f"what gains most on held-out data gains {max(best, 0.0):.0f}; a twin's own mismatch gains up to "
                f"{CROWDED_GAIN:.0f}, and an effect that stands alone needs {LEAST_GAIN:.0f} and to pass all tests"
            )
        if episodes < 2:
            reason = f"of one motion nothing can be named: {reason}"
            next_step = A_SECOND_MOTION
        return Verdict(outcome=outcome, judged=(), reason=reason, experiment=next_step)
    best_one = good[0]
    if near and not rivals:
        alike = ", ".join(each.name for each in near)
        return Verdict(
            outcome=Outcome.UNEXPLAINED,
            judged=(),
            reason=f"{best_one.name} gains {best_one.gain:.0f}, but {alike} gains about as much and is refuted: what "
            "they share is no evidence for either",
            experiment=experiment(best_one.name, episodes < 2),
        )
    if rivals or episodes < 2 or level(best_one):
        names = ", ".join(each.name for each in (best_one, *rivals))
        if rivals:
            why = f"{names} explain the residual about equally well"
        elif episodes < 2:
            why = f"{best_one.name} explains the residual, but of one motion only"
        else:
            (other,) = THE_SAME - {best_one.name}
            why = f"{best_one.name} explains the residual, and so would {other}"
        return Verdict(
            outcome=Outcome.AMBIGUOUS,
            judged=(best_one, *rivals),
            reason=why,
            experiment=experiment(best_one.name, episodes < 2),
        )
    return Verdict(
        outcome=Outcome.NAMED,
        judged=(best_one,),
        reason=f"{best_one.name} gains {best_one.gain:.0f} on held-out data "
        f"(95 %: {best_one.gain_ci95[0]:.0f} to {best_one.gain_ci95[1]:.0f}), where at most {LARGEST_P:.0%} of shams "
        "gain as much, and clearly more than any other effect",
        experiment=None,
    )


def experiment(name: str, one_motion: bool) -> str:
    """What to do next to tell an effect from what mimics it."""
    effect = effect_named(name)
    more = "record a second episode of another motion; then " if one_motion else ""
    return f"{more}{effect.traits.experiment} (tells {name} from {', '.join(effect.traits.confounders)})"
