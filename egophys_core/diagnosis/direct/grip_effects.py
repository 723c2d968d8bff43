"""The effects that grips tell: chosen one after the other, each held against the fit without it."""

from collections.abc import Sequence

import numpy as np

from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.direct.grip_fit import GripFit, explained, fit_grips, gains, intervals, p_null
from egophys_core.diagnosis.direct.grips import GripRecord
from egophys_core.diagnosis.direct.measured import MeasuredEffect, Recordings, measured
from egophys_core.effects import effect_named

HELD_M = 0.005
"""Metres of residual, at least, that held tracks may have with all that was found: what is farther off, and off by more
than its noise, is not held."""

Grips = Sequence[GripRecord]


def grip_effects(names: Sequence[str], recordings: Recordings) -> list[MeasuredEffect]:
    """What grips tell of the effects of some names, where two episodes have grips."""
    if recordings.fitted[0].observed.is_sparse:
        return []
    episodes = recordings.fitted_grips
    if len(episodes) < 2:
        return []
    grips = [grip for each in episodes for grip in each]
    best, others = _selected(grips, names, recordings.thresholds.measured_gain)
    if np.sqrt(best.squares.max()) > max(HELD_M, *(grip.noise for grip in grips)):
        return []
    fits = {**dict.fromkeys(best.values, best), **others}
    return [_measured(name, fit, recordings) for name, fit in fits.items()]


def _selected(grips: Grips, names: Sequence[str], least_gain: float) -> tuple[GripFit, dict[str, GripFit]]:
    """Forward selection: the fit with one effect after the other as long as one gains, and those with one more each."""
    best = explained(grips, {})
    while left := [name for name in names if name not in best.values]:
        others = {name: fit_grips(grips, (*best.values, name)) for name in left}
        name = max(left, key=lambda each: float(gains(grips, best, others[each]).sum()))
        if gains(grips, best, others[name]).sum() < least_gain:
            return best, others
        best = others[name]
    return best, {}


def _measured(name: str, fit: GripFit, recordings: Recordings) -> MeasuredEffect:
    """One of the effects that grips were fitted with, held against the same fit without it."""
    episodes, validation = recordings.fitted_grips, recordings.validation_grips
    grips = [grip for each in episodes for grip in each]
    names = tuple(fit.values)
    rest = tuple(each for each in names if each != name)

    def fit_without(some: Grips) -> GripFit:
        return fit_grips(some, rest) if rest else explained(some, {})

    without = fit_without(grips)
    held_out = []
    for index, own in enumerate(episodes):
        others = [grip for each in (*episodes[:index], *episodes[index + 1 :]) for grip in each]
        before, after = (explained(own, each.values) for each in (fit_without(others), fit_grips(others, names)))
        held_out.append(float(gains(own, before, after).sum()))
    validated = None
    if validation:
        before, after = (explained(validation, each.values) for each in (without, fit))
        validated = float(gains(validation, before, after).sum())
    ends = intervals(grips, fit, resamples=recordings.resamples, seed=recordings.seed)[name]
    left = [1e3 * float(np.sqrt(each.squares.mean())) for each in (without, fit)]
    return measured(
        name,
        parameters={
            each.name: Estimate(value=fit.values[name][each.name], unit=each.unit, ci95=ends[each.name])
            for each in effect_named(name).parameters
        },
        fitted_gain=float(gains(grips, without, fit).sum()),
        held_out_gains=held_out,
        validation_gain=validated,
        p_null=p_null(grips, without, fit, seed=recordings.seed),
        reason=f"{name} is measured in {len(grips)} grips: what is held is off the hand's path by {left[0]:.1f} mm "
        f"without it, by {left[1]:.1f} mm with it",
        thresholds=recordings.thresholds,
    )
