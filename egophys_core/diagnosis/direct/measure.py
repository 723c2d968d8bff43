"""Effects that are measured directly, before any physics of the object.

Grips tell whether the record of the hands is early, too small or too large, and whether the object slips; a sheet that
lies flat tells whether the tracking frame is level; what swings in a clamp, whether its material relaxes. The twin,
which is never right, has no part in it.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.direct.grip_fit import TOLD, GripFit, explained, fit_grips, gains, intervals, p_null
from egophys_core.diagnosis.direct.grips import GripRecord, grips_of
from egophys_core.diagnosis.direct.ring_down import Swing, swing_of
from egophys_core.diagnosis.direct.ring_down_fit import FLOOR, counts, explained_swings, fit_swings, swing_gains
from egophys_core.diagnosis.direct.surrogates import shifted_p
from egophys_core.diagnosis.direct.table_level import tilt, tilt_gain
from egophys_core.diagnosis.evidence.residuals import Observation
from egophys_core.diagnosis.verdict.decide import EVENTS, LARGEST_P
from egophys_core.effects import effect_named

LEAST_GAIN = 12.0
"""Gain in log-likelihood from which an effect shows: where it is not planted, in 68 rehearsed and 13 recorded cases, it
gains 2 at most; the small planted sizes gain 21 and more."""

HELD_M = 0.005
"""Metres by which held tracks may still miss their hand with all that was found: what misses it by more is not held."""

OSCILLATES = 0.1
"""Of a swing, root mean square, that an oscillator may leave: what leaves more is none."""

SEEN_TO_END = 0.5
"""Of the shortest record, that relaxation may take: what goes on and on may as well be flow."""

SHAMS = 200
"""Tilts as large in other directions."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """An effect that was measured directly, and shows or does not."""

    name: str
    shows: bool
    """Beyond chance, in what was left out, and in what was not fitted."""
    parameters: dict[str, Estimate]
    fitted_gain: float
    held_out_gain: float
    """Each episode by the numbers of the others."""
    proof_gain: float | None
    """In episodes that took no part; None without any."""
    p_null: float
    episodes_agree: bool
    """Whether it gains in every episode that was left out."""
    reason: str

    @property
    def values(self) -> dict[str, float]:
        """The numbers alone."""
        return {name: each.value for name, each in self.parameters.items()}


def measure(
    observations: Sequence[Observation],
    proofs: Sequence[Observation],
    *,
    lies_flat: bool,
    without: Collection[str],
    resamples: int,
    seed: int,
) -> list[Measured]:
    """The effects that two episodes or more tell directly: those that show, the clearest first, and those that do not.

    Args:
        observations: what is fitted.
        proofs: episodes that are not, which must bear an effect out.
        lies_flat: whether the object lies flat when it lies.
        without: names of effects that are left out.
        resamples: for intervals.
        seed: of resamples and shams.
    """
    if len(observations) < 2:
        return []
    if observations[0].free:
        return [] if "viscoelasticity" in without else _relaxation(observations, proofs, seed)
    tilted = _tilt(observations, proofs, seed) if lies_flat and "tracking_rotation" not in without else None
    told = _grips(observations, proofs, [name for name in TOLD if name not in without], resamples, seed)
    found = [*([tilted] if tilted else []), *told]
    return sorted(found, key=lambda each: (not each.shows, -each.fitted_gain))


def _tilt(observations: Sequence[Observation], proofs: Sequence[Observation], seed: int) -> Measured | None:
    """The tilt of the tracking frame, by a sheet at rest."""
    rests = [each.rest for each in observations]
    tilts = [tilt(rest) for rest in rests]
    found = np.array([each for each in tilts if each is not None])
    if len(found) < len(tilts):
        return None
    about, count = found.mean(axis=0), len(found)
    fitted = sum(tilt_gain(rest, about) for rest in rests)
    held_out = np.array(
        [tilt_gain(rest, (found.sum(axis=0) - own) / (count - 1)) for rest, own in zip(rests, found, strict=True)]
    )
    proof = sum(tilt_gain(each.rest, about) for each in proofs) if proofs else None
    angles = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, SHAMS)
    turned = np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.linalg.norm(about)
    shams = np.array([sum(tilt_gain(rest, sham) for rest in rests) for sham in turned])
    width = student.ppf(0.975, count - 1) * found.std(axis=0, ddof=1) / np.sqrt(count)
    parameters = effect_named("tracking_rotation").parameters
    return _judged(
        Measured(
            name="tracking_rotation",
            shows=True,
            parameters={
                each.name: Estimate(value=float(value), unit=each.unit, ci95=(float(value - wide), float(value + wide)))
                for each, value, wide in zip(parameters, about, width, strict=True)
            },
            fitted_gain=float(fitted),
            held_out_gain=float(held_out.sum()),
            proof_gain=proof,
            p_null=float((1 + np.sum(shams >= fitted)) / (1 + SHAMS)),
            episodes_agree=bool((held_out > 0.0).all()),
            reason="tracking_rotation is measured at rest: the sheet lies "
            f"{np.degrees(np.linalg.norm(about)):.1f} degrees aslant in all {count} episodes",
        )
    )


def _grips(
    observations: Sequence[Observation],
    proofs: Sequence[Observation],
    names: Sequence[str],
    resamples: int,
    seed: int,
) -> list[Measured]:
    """What grips tell: one effect after the other, as long as one gains; of the others that they do not show."""
    episodes = [grips for grips in map(grips_of, observations) if grips]
    proven = [grip for each in proofs for grip in grips_of(each)]
    if len(episodes) < 2:
        return []
    grips = [grip for each in episodes for grip in each]
    best, others = explained(grips, {}), dict[str, GripFit]()
    while left := [name for name in names if name not in best.numbers]:
        others = {name: fit_grips(grips, (*best.numbers, name)) for name in left}
        name = max(left, key=lambda each: float(gains(grips, best, others[each]).sum()))
        if gains(grips, best, others[name]).sum() < LEAST_GAIN:
            break
        best = others.pop(name)
    if np.sqrt(best.misses.max()) > HELD_M:
        return []
    fits = {**dict.fromkeys(best.numbers, best), **{name: others[name] for name in names if name not in best.numbers}}
    return [
        _grip_effect(name, fit, episodes, proven, resamples, seed, shows=name in best.numbers)
        for name, fit in fits.items()
    ]


def _grip_effect(
    name: str,
    fit: GripFit,
    episodes: Sequence[Sequence[GripRecord]],
    proofs: Sequence[GripRecord],
    resamples: int,
    seed: int,
    *,
    shows: bool,
) -> Measured:
    """One of the effects that grips were fitted with, held against the same fit without it."""
    grips = [grip for each in episodes for grip in each]
    names = tuple(fit.numbers)
    rest = tuple(each for each in names if each != name)

    def bare(some: Sequence[GripRecord]) -> GripFit:
        return fit_grips(some, rest) if rest else explained(some, {})

    without = bare(grips)
    held_out = []
    for index, own in enumerate(episodes):
        others = [grip for each in (*episodes[:index], *episodes[index + 1 :]) for grip in each]
        before, after = (explained(own, each.numbers) for each in (bare(others), fit_grips(others, names)))
        held_out.append(gains(own, before, after).sum())
    proof = None
    if proofs:
        proof = float(gains(proofs, explained(proofs, without.numbers), explained(proofs, fit.numbers)).sum())
    ends = intervals(grips, fit, resamples=resamples, seed=seed)[name]
    missed = [1e3 * float(np.sqrt(each.misses.mean())) for each in (without, fit)]
    return _judged(
        Measured(
            name=name,
            shows=shows,
            parameters={
                each.name: Estimate(value=fit.numbers[name][each.name], unit=each.unit, ci95=ends[each.name])
                for each in effect_named(name).parameters
            },
            fitted_gain=float(gains(grips, without, fit).sum()),
            held_out_gain=float(np.sum(held_out)),
            proof_gain=proof,
            p_null=p_null(grips, without, fit, seed=seed),
            episodes_agree=bool(np.min(held_out) > 0.0),
            reason=f"{name} is measured in {len(grips)} grips: what is held misses the hand by {missed[0]:.1f} mm "
            f"without it, by {missed[1]:.1f} mm with it",
        )
    )


def _relaxation(observations: Sequence[Observation], proofs: Sequence[Observation], seed: int) -> list[Measured]:
    """Whether the material relaxes, by how an object swings that is let go in a clamp; nothing where one does not."""
    swings = _told_by_swings(observations)
    if len(swings) < len(observations):
        return []
    before, after = explained_swings(swings), fit_swings(swings)
    held_out = []
    for index, own in enumerate(swings):
        others = fit_swings([*swings[:index], *swings[index + 1 :]])
        held_out.append(_gain([own], others.ratio, others.time))
    changes = [one - other for one, other in zip(before.left, after.left, strict=True)]
    proven = _told_by_swings(proofs)
    sizes = [1e3 * float(np.sqrt(each.misses.mean())) for each in (before, after)]
    measured = Measured(
        name="viscoelasticity",
        shows=after.time <= SEEN_TO_END * min(swing.times[-1] for swing in swings),
        parameters={
            each.name: Estimate(value=getattr(after, each.name), unit=each.unit, ci95=after.ci95[each.name])
            for each in effect_named("viscoelasticity").parameters
        },
        fitted_gain=float(swing_gains(swings, before, after).sum()),
        held_out_gain=float(np.sum(held_out)),
        proof_gain=_gain(proven, after.ratio, after.time) if proven else None,
        p_null=shifted_p(
            before.left, changes, counts(swings), [swing.times[-1] for swing in swings], floor=FLOOR, seed=seed
        ),
        episodes_agree=bool(np.min(held_out) > 0.0),
        reason=f"viscoelasticity is measured in {len(swings)} swings: an oscillator misses them by {sizes[0]:.2f} mm "
        f"without it, by {sizes[1]:.2f} mm with it",
    )
    return [_judged(measured)]


def _told_by_swings(observations: Sequence[Observation]) -> list[Swing]:
    """The swings of those records in which an object swings as an oscillator does."""
    found = [swing_of(each.record) for each in observations if each.record is not None]
    swings = [each for each in found if each is not None]
    most = [OSCILLATES * np.ptp(each.places) for each in swings]
    return [each for each, bound in zip(swings, most, strict=True) if explained_swings([each]).misses[0] < bound**2]


def _gain(swings: Sequence[Swing], ratio: float, time: float) -> float:
    """What given numbers gain in swings."""
    return float(swing_gains(swings, explained_swings(swings), explained_swings(swings, ratio, time)).sum())


def _judged(measured: Measured) -> Measured:
    """The effect, which shows no more if it does so by chance, or not in what was left out or not fitted."""
    disproven = measured.proof_gain is not None and measured.proof_gain <= 0.0 and measured.name not in EVENTS
    gained = min(measured.fitted_gain, measured.held_out_gain) >= LEAST_GAIN and measured.p_null <= LARGEST_P
    return replace(measured, shows=measured.shows and gained and measured.episodes_agree and not disproven)
