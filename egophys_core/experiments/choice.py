"""The choice of a motion: the one from which most is learned of the effects that are asked about."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.effects import effect_named
from egophys_core.errors import EgophysError, PlanningError
from egophys_core.experiments.arm_limits import why_no_motion_of_an_arm
from egophys_core.experiments.family import LONGEST_S, HandLimits, HandMotion, motions_for
from egophys_core.experiments.prediction import predicted_episode
from egophys_core.experiments.sensitivity import limits_in
from egophys_core.twin import Twin

MOST_MOTIONS = 2
"""Motions that are proposed together, if nothing else is asked for."""

WORTH_A_SECOND = 0.2
"""Of the logarithm of a limit, mean over effects, that a second motion must lower to be proposed as well."""


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """A motion to do, and what it is expected to show."""

    motion: HandMotion
    score: float
    """Mean over the effects of ln(limit before / limit after)."""
    before: tuple[DetectionLimit, ...]
    """What could be named without it."""
    after: tuple[DetectionLimit, ...]
    """What could be named with it as well."""


def choose(
    twin: Twin,
    effects: Sequence[str],
    limits: HandLimits,
    *,
    known: Sequence[DetectionLimit] = (),
    rivals: Collection[str] = (),
    done: Collection[str] = (),
    needed_gain: float,
    least_scale: float,
    most: int = MOST_MOTIONS,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> list[Proposal]:
    """The motions to do next, the best first.

    Args:
        twin: as good as it is known.
        effects: names of those that are asked about.
        known: detection limits of the recordings there are.
        rivals: effects that these cannot tell apart: a motion in which they look alike says nothing of them.
        done: names of motions that were asked for already: `known` says what they showed, and that was not enough.
        needed_gain: in log-likelihood, to be named.
        least_scale: metres, residuals that the twin has at least.
        most: motions to propose; what is said of each takes the time of some ten that are not chosen.
        progress: called with stage and share done.

    Raises:
        PlanningError: hands can do none of the motions with the object, or no other, or the twin can be simulated in
            none.
    """
    motions = _motions_left(twin, limits, done)
    shown: dict[str, tuple[DetectionLimit, ...]] = {}

    def limits_of(motion: HandMotion, *, refitted: bool) -> tuple[DetectionLimit, ...] | None:
        """None where the twin cannot be followed: what such a motion shows cannot be judged."""
        try:
            episode = predicted_episode(twin.model, motion, ground_height=twin.ground_height)
            return limits_in(
                twin.model, episode, effects, needed_gain=needed_gain, least_scale=least_scale, refitted=refitted
            )
        except EgophysError:
            return None

    for index, motion in enumerate(motions):
        progress(motion.name, index / len(motions))
        found = limits_of(motion, refitted=False)
        if found is not None:
            shown[motion.name] = found
    if not shown:
        raise PlanningError("the twin can be simulated in none of the motions; build it anew, or give other --effects")
    before = tuple(known)
    proposals: list[Proposal] = []
    for _ in range(most):
        proposed = {each.motion.name for each in proposals}
        tried = [
            _proposal(motion, before, shown[motion.name], rivals)
            for motion in motions
            if motion.name in shown and motion.name not in proposed
        ]
        best = max(tried, key=lambda each: each.score, default=None)
        if best is None or (proposals and best.score < WORTH_A_SECOND):
            break
        # What is said of the chosen one is worth more time than what the others are left out for.
        closer = limits_of(best.motion, refitted=True) or shown[best.motion.name]
        proposals.append(_proposal(best.motion, before, closer, rivals))
        before = proposals[-1].after
    return proposals


def _motions_left(twin: Twin, limits: HandLimits, done: Collection[str]) -> list[HandMotion]:
    """The motions that can be done and were not asked for; at least one.

    Raises:
        PlanningError: there is none; says why.
    """
    left, refused = list[HandMotion](), dict[str, list[str]]()
    for motion in motions_for(twin, limits):
        if motion.name in done:
            continue
        reason = why_no_motion_of_an_arm(motion, twin, limits.arm) if limits.arm else None
        if reason is None:
            left.append(motion)
        else:
            refused.setdefault(reason, []).append(motion.name)
    if left:
        return left
    if refused:
        reasons = [f"not {', '.join(map(repr, names))} ({reason})" for reason, names in refused.items()]
        raise PlanningError(f"the limits of the arm allow no motion with the object: {', '.join(reasons)}")
    if done:
        raise PlanningError(f"hands can do no motion with the object but those that were asked for: {', '.join(done)}")
    raise PlanningError(
        f"at most {limits.fastest_m_s:g} m/s is too slow for any motion of at most {LONGEST_S:g} s with the object; "
        "allow a higher speed"
    )


def _proposal(
    motion: HandMotion, before: Sequence[DetectionLimit], found: Sequence[DetectionLimit], rivals: Collection[str]
) -> Proposal:
    known: Mapping[tuple[str, str], DetectionLimit] = {(each.effect, each.parameter): each for each in before}
    after = tuple(together(known.get((each.effect, each.parameter)), each) for each in found)
    gains: dict[str, list[float]] = {}
    for each in after:
        earlier = known.get((each.effect, each.parameter))
        told = each.effect not in rivals or not set(each.alike) & set(rivals)
        gains.setdefault(each.effect, []).append(_gained(earlier, each) if told else 0.0)
    score = float(np.mean([np.mean(each) for each in gains.values()])) if gains else 0.0
    return Proposal(motion=motion, score=score, before=tuple(before), after=after)


def together(one: DetectionLimit | None, other: DetectionLimit) -> DetectionLimit:
    """The limit of two sets of recordings together: gains add, and each grows as the square of a small size."""
    if one is None or one.size is None or other.size is None:
        return other if one is None or one.size is None else one
    size = float((one.size**-2 + other.size**-2) ** -0.5)
    # What one of them tells apart is told.
    return replace(other, size=size, alike=tuple(name for name in other.alike if name in one.alike))


def _gained(before: DetectionLimit | None, after: DetectionLimit) -> float:
    """ln of the limit before over that after; what shows in no size has the largest that an effect may have."""
    if after.size is None:
        return 0.0
    definition = next(each for each in effect_named(after.effect).parameters if each.name == after.parameter)
    largest = max(abs(definition.high - after.null), abs(definition.low - after.null))
    known = largest if before is None or before.size is None else before.size
    return float(np.log(known / after.size))
