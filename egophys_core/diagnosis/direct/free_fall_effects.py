"""The effects that falls of solids tell: chosen one after the other, each held against the fit without it.

A sheet opens as it falls: the mean of its tracks is no fall of its middle. With 0.85 of their mass added at a place
sheets fell by 1.6 m/s^2 less than they should (root mean square of 8), as by a gravity of 0.85.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from egophys_core.constants import GRAVITY
from egophys_core.diagnosis.diagnosis import DetectionLimit, Estimate
from egophys_core.diagnosis.direct.free_fall import falls_in
from egophys_core.diagnosis.direct.measured import MeasuredEffect, Recordings, measured
from egophys_core.diagnosis.direct.size_limits import size_limits
from egophys_core.diagnosis.evidence.residuals import TrackedEpisode
from egophys_core.effects import Effect, effect_named, general_forms
from egophys_core.effects.traits import Measurement

FREELY = np.array([0.0, 0.0, -GRAVITY, 0.0])
"""[4] how something falls that nothing else acts on, as in `Fall`."""

SPREAD = np.array([0.07, 0.07, 0.25, 0.3])
"""[4] standard deviations by which falls are off that where nothing pulls at all of the object: what is seen is not all
of it, and turns about the rest. 60 falls of 10 rehearsed ellipsoids and boxes, a third each with nothing, an added mass
and springs that relax, were off by 0.03, 0.02, 0.35 and 0.17 (root mean square; largest 0.07, 0.04, 0.63, 0.28):
air takes 0.5 1/s of their speed there."""


@dataclass(frozen=True, kw_only=True)
class Halves:
    """Halves of the tracks of falls: each is left out in turn, and counts as half a fall."""

    off: np.ndarray
    """[H, 4] by how much each fell otherwise than `FREELY`."""
    spread: np.ndarray
    """[H, 4] standard deviations of that."""

    def but(self, index: int) -> "Halves":
        """All but one."""
        return Halves(off=np.delete(self.off, index, axis=0), spread=np.delete(self.spread, index, axis=0))

    def gains(self, without: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """[H] what they gain in log-likelihood by falling otherwise in one way [4] over another."""
        return np.asarray(np.sum(((self.off - without) ** 2 - (self.off - motion) ** 2) / self.spread**2, axis=1) / 4.0)


@dataclass(frozen=True, kw_only=True)
class FallFit:
    """Effects fitted to falls."""

    values: dict[str, dict[str, float]]
    """By effect and parameter."""
    motion: np.ndarray
    """[4] by how much something falls otherwise with them than `FREELY`."""
    widths: dict[str, dict[str, float]]
    """Standard deviations of the values."""


def free_fall_effects(names: Sequence[str], recordings: Recordings) -> list[MeasuredEffect]:
    """What falls tell of the effects of some names, where there is one."""
    halves = _halves(recordings.fitted, lies_flat=recordings.lies_flat)
    if halves is None:
        return []
    checks = _halves(recordings.validation, lies_flat=recordings.lies_flat)
    best, others = _selected(halves, names, recordings)
    fits = {**dict.fromkeys(best.values, best), **others}

    def held_against(name: str, fit: FallFit) -> MeasuredEffect:
        return _measured(name, fit, halves, checks, recordings)

    found = [held_against(name, fit) for name, fit in fits.items()]
    return [
        replace(each, alike=tuple(held_against(*other) for other in _equivalents(each, fits, halves).items()))
        for each in found
    ]


def _equivalents(shown: MeasuredEffect, fits: Mapping[str, FallFit], halves: Halves) -> dict[str, FallFit]:
    """Effects that are one thing with one that shows, and the fits in which they take its place."""
    traits = effect_named(shown.name).traits
    if not (shown.shows and traits.is_horizontal(shown.values)):
        return {}
    rest = tuple(name for name in fits[shown.name].values if name != shown.name)
    names = [name for name in traits.equivalent_to if name in fits and name not in rest]
    return {name: _fit(halves, (*rest, name)) for name in names}


def fall_limits(
    names: Sequence[str], observations: Sequence[TrackedEpisode], *, lies_flat: bool, needed: float
) -> list[DetectionLimit]:
    """The limit of every size of some effects in the falls of episodes; nothing without a fall.

    Args:
        needed: gain in log-likelihood from which an effect shows.
    """
    halves = _halves(observations, lies_flat=lies_flat)
    if halves is None:
        return []

    def gain(effect: Effect, size: str, off: float) -> float:
        values = {each.name: each.null or 0.0 for each in effect.parameters}
        values[size] += off
        return float(np.sum((_motion({effect.name: values}) / halves.spread) ** 2) / 4.0)

    return size_limits(names, gain, needed=needed, one_thing=True)


def measured_by_falls(names: Collection[str]) -> list[str]:
    """Those of some effects that falls tell."""
    return [name for name in names if Measurement.FREE_FALL in effect_named(name).traits.measured_by]


def _halves(observations: Sequence[TrackedEpisode], *, lies_flat: bool) -> Halves | None:
    """Those of all falls of episodes; None without a fall, and of sheets."""
    falls = [] if lies_flat else [each for one in observations for each in falls_in(one)]
    if not falls:
        return None
    return Halves(
        off=np.concatenate([each.motions for each in falls]) - FREELY,
        spread=np.hypot(SPREAD, np.concatenate([each.widths for each in falls])),
    )


def _motion(values: Mapping[str, Mapping[str, float]]) -> np.ndarray:
    """[4] by how much something with effects falls otherwise than freely."""
    moved = [effect_named(name).falls(dict(own)) - FREELY for name, own in values.items()]  # type: ignore[misc]
    return np.asarray(sum(moved, np.zeros(4)))


def _fit(halves: Halves, names: Sequence[str]) -> FallFit:
    """Effects fitted together to falls."""
    parameters = [(name, each) for name in names for each in effect_named(name).parameters]

    def named(numbers: np.ndarray) -> dict[str, dict[str, float]]:
        found: dict[str, dict[str, float]] = {name: {} for name in names}
        for (name, parameter), value in zip(parameters, numbers, strict=True):
            found[name][parameter.name] = float(value)
        return found

    if not parameters:
        return FallFit(values={}, motion=np.zeros(4), widths={})
    bounds = np.array([(each.low, each.high) for _, each in parameters]).T
    null = np.array([each.null or 0.0 for _, each in parameters])
    steps = np.array([each.step for _, each in parameters])
    start = np.clip(null + 0.1 * steps, *bounds)

    def left(numbers: np.ndarray) -> np.ndarray:
        # Two halves are one fall.
        return np.ravel((halves.off - _motion(named(numbers))) / (np.sqrt(2.0) * halves.spread))

    found = least_squares(left, start, bounds=bounds, x_scale=steps)
    covariance = np.linalg.pinv(found.jac.T @ found.jac)
    return FallFit(
        values=named(found.x),
        motion=_motion(named(found.x)),
        widths=named(np.sqrt(np.maximum(np.diag(covariance), 0.0))),
    )


def _selected(halves: Halves, names: Sequence[str], recordings: Recordings) -> tuple[FallFit, dict[str, FallFit]]:
    """Forward selection: the fit with one effect after the other as long as one gains, and those with one more each.

    Of a general effect and a special case that explains about as much the special case is taken.
    """
    thresholds, best = recordings.thresholds, _fit(halves, ())
    while left := [name for name in names if name not in best.values]:
        others = {name: _fit(halves, (*best.values, name)) for name in left}
        gains = {name: float(halves.gains(best.motion, fit.motion).sum()) for name, fit in others.items()}
        name = max(left, key=lambda each: gains[each])
        if gains[name] < thresholds.measured_gain:
            return best, others
        special = [each for each in effect_named(name).traits.special_cases if each in gains]
        enough = [each for each in special if gains[each] >= thresholds.equal_share * gains[name]]
        best = others[max(enough, key=lambda each: gains[each]) if enough else name]
    return best, {}


def _measured(
    name: str,
    fit: FallFit,
    halves: Halves,
    validation: Halves | None,
    recordings: Recordings,
) -> MeasuredEffect:
    """One of the effects that falls were fitted with, held against the same fit without it."""
    effect, rest = effect_named(name), tuple(each for each in fit.values if each != name)
    without = _fit(halves, rest).motion
    held_out = []
    for index in range(len(halves.off)):
        before, after = (_fit(halves.but(index), each).motion for each in (rest, (*rest, name)))
        held_out.append(float(halves.gains(before, after)[index]))
    fitted = float(halves.gains(without, fit.motion).sum())
    also = (*effect.traits.equivalent_to, *effect.traits.equivalent_in_air)
    general = [each for each in general_forms(name) if not effect_named(each).falls]
    falls = len(halves.off) // 2
    fell = halves.off.mean(axis=0) + FREELY
    return measured(
        name,
        parameters={
            each.name: Estimate(
                value=fit.values[name][each.name],
                unit=each.unit,
                ci95=_interval(fit.values[name][each.name], fit.widths[name][each.name]),
            )
            for each in effect.parameters
        },
        fitted_gain=fitted,
        held_out_gains=held_out,
        validation_gain=None if validation is None else float(validation.gains(without, fit.motion).sum()),
        p_null=float(chi2.sf(2.0 * fitted, len(effect.parameters))),
        reason=f"{name} is measured in {falls} falls: it falls by "
        f"({', '.join(f'{value:.2f}' for value in fell[:3])}) m/s^2, and air takes {max(fell[3], 0.0):.1f} 1/m of its "
        "speed squared"
        + (f", as it would by {' or '.join(also)}" if also else "")
        + (
            f"; one fall does not tell it from {' or '.join(general)}: let it fall elsewhere and later, too"
            if falls == 1 and general
            else ""
        ),
        thresholds=recordings.thresholds,
    )


def _interval(value: float, width: float) -> tuple[float, float]:
    return value - 1.96 * width, value + 1.96 * width
