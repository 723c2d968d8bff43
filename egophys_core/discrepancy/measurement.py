"""Effects that are measured directly, before any physics of the object.

Grips tell whether the record of the hands is early, too small or too large, and whether the object slips; a sheet that
lies flat tells whether the tracking frame is level. The twin, which is never right, has no part in it.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from egophys_core.discrepancy.diagnosis import Estimate
from egophys_core.discrepancy.effects import effect_named
from egophys_core.discrepancy.grip_fit import TOLD, GripFit, explained, fit_grips, gains, intervals, p_null
from egophys_core.discrepancy.grips import GripRecord, grips_of
from egophys_core.discrepancy.residuals import Observation
from egophys_core.discrepancy.table_level import tilt, tilt_gain
from egophys_core.discrepancy.verdict import EVENTS, LARGEST_P

LEAST_GAIN = 12.0
"""Gain in log-likelihood from which an effect is measured: where none of these is planted, in 60 rehearsed sets and 11
recorded cases, nothing gains 3; the small planted sizes gain 21 and more."""

HELD_M = 0.005
"""Metres by which held tracks may still miss their hand with all that was found: what misses it by more is not held."""

SHAMS = 200
"""Tilts as large in other directions."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """An effect that was measured directly."""

    name: str
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
    is_sheet: bool,
    without: Collection[str],
    resamples: int,
    seed: int,
) -> list[Measured]:
    """The effects that show directly in two episodes or more, the clearest first.

    Args:
        observations: what is fitted.
        proofs: episodes that are not, which must bear an effect out.
        is_sheet: whether the object lies flat when it lies.
        without: names of effects that are left out.
        resamples: for intervals.
        seed: of resamples and shams.
    """
    if len(observations) < 2:
        return []
    tilted = _tilt(observations, proofs, seed) if is_sheet and "tracking_rotation" not in without else None
    told = _grips(observations, proofs, [name for name in TOLD if name not in without], resamples, seed)
    return [*([tilted] if tilted else []), *told]


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
    return _accepted(
        Measured(
            name="tracking_rotation",
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
    """What grips tell: one effect after the other, as long as one gains."""
    episodes = [grips for grips in map(grips_of, observations) if grips]
    proven = [grip for each in proofs for grip in grips_of(each)]
    if len(episodes) < 2:
        return []
    grips = [grip for each in episodes for grip in each]
    chosen: tuple[str, ...] = ()
    best = explained(grips, {})
    while left := [name for name in names if name not in chosen]:
        fits = [fit_grips(grips, (*chosen, name)) for name in left]
        gained = [gains(grips, best, fit).sum() for fit in fits]
        if max(gained) < LEAST_GAIN:
            break
        best = fits[int(np.argmax(gained))]
        chosen = tuple(best.numbers)
    if np.sqrt(best.misses.max()) > HELD_M:
        return []
    found = [_grip_effect(name, best, episodes, proven, resamples, seed) for name in chosen]
    return [each for each in found if each]


def _grip_effect(
    name: str,
    fit: GripFit,
    episodes: Sequence[Sequence[GripRecord]],
    proofs: Sequence[GripRecord],
    resamples: int,
    seed: int,
) -> Measured | None:
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
    return _accepted(
        Measured(
            name=name,
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


def _accepted(measured: Measured) -> Measured | None:
    """The effect, if it shows beyond chance, in what was left out and in what was not fitted."""
    disproven = measured.proof_gain is not None and measured.proof_gain <= 0.0 and measured.name not in EVENTS
    gained = min(measured.fitted_gain, measured.held_out_gain) >= LEAST_GAIN
    return measured if gained and measured.p_null <= LARGEST_P and measured.episodes_agree and not disproven else None
