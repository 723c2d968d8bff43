"""The effects that falls tell: chosen one after the other, each held against the fit without it."""

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
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import Effect, effect_named, general_forms
from egophys_core.effects.traits import Measurement

FREELY = np.array([0.0, 0.0, -GRAVITY, 0.0, 0.0])
"""[5] how something falls that nothing else acts on, as in `Fall`."""

USUAL_AIR = np.array([0.0, 0.0, 0.15, 0.1, 0.0])
"""[5] what air does to that anyway: half of what it does where it takes 0.5 1/s of its speed, as in the rehearsal."""

SPREAD = np.array([0.05, 0.05, 0.15, 0.2, 0.02])
"""[5] standard deviations by which falls are off `FREELY` and `USUAL_AIR` where nothing pulls at all of the object: no
air and that of the rehearsal are one of them off, what is seen of a solid is not all of it, and turns about the rest.
60 falls of 10 rehearsed ellipsoids and boxes, a third each with nothing, an added mass and springs that relax, were off
by 0.03, 0.02, 0.21 and 0.09 (root mean square; largest 0.07, 0.04, 0.48, 0.18); 15 of nine sheets from two hands, with
nothing or with springs that relax, by 0.01, 0.04, 0.14 and 0.09 (0.02, 0.08, 0.20, 0.14)."""

LEAST_TOLD = np.array([0.2, 0.2, 0.6])
"""[3] m/s^2, the standard deviations with which a fall of a sheet tells a steady pull at most: other motions tell more
than one that swings as it falls. What of a solid a fall does not tell no other motion does."""

PARAMETER_GAIN, RIVAL_GAIN = 2.0, 3.0
"""In log-likelihood: what a further parameter must gain, and by how much less an effect that stands for another must
gain to be told from it."""

Values = Mapping[str, Mapping[str, float]]
"""By effect and parameter."""


@dataclass(frozen=True, kw_only=True)
class HalvesOfFalls:
    """HalvesOfFalls of the tracks of falls, two by two; each counts as half a fall."""

    motions: np.ndarray
    """[H, 5] how each fell, as in `Fall`."""
    whitening: np.ndarray
    """[H, 5, 5] that brings this to independent standard deviations."""

    def taken(self, chosen: np.ndarray) -> "HalvesOfFalls":
        """Some of them, by their indices."""
        return replace(self, motions=self.motions[chosen], whitening=self.whitening[chosen])

    def left_out(self) -> list[np.ndarray]:
        """Indices of what is left out in turn: each fall, whose halves have its swing in common; each half of one."""
        rows = np.arange(len(self.motions))
        return list(rows.reshape(-1, 2) if len(rows) > 2 else rows[:, None])

    def left(self, values: Values) -> np.ndarray:
        """[H, 5] standard deviations by which they fell otherwise than with effects."""
        return self.whitened(self.motions - FREELY - USUAL_AIR - _motion(values))

    def whitened(self, off: np.ndarray) -> np.ndarray:
        """[H, 5] standard deviations, of what they are off by [5] or [H, 5]."""
        return np.asarray(np.einsum("hij,hj->hi", self.whitening, np.broadcast_to(off, self.motions.shape)))

    def gains(self, without: Values, values: Values) -> np.ndarray:
        """[H] what they gain in log-likelihood by some effects over others. Two halves are one fall."""
        return np.asarray(np.sum(self.left(without) ** 2 - self.left(values) ** 2, axis=1) / 4.0)


@dataclass(frozen=True, kw_only=True)
class FallFit:
    """Effects fitted to falls."""

    values: dict[str, dict[str, float]]
    """By effect and parameter."""
    widths: dict[str, dict[str, float]]
    """Standard deviations of the values."""


def free_fall_effects(names: Sequence[str], recordings: Recordings) -> list[MeasuredEffect]:
    """What falls tell of the effects of some names, where there is one."""
    halves = _halves_of_falls(recordings.fitted, lies_flat=recordings.lies_flat)
    if halves is None:
        return []
    checks = _halves_of_falls(recordings.validation, lies_flat=recordings.lies_flat)
    best, others = _selected(halves, names, recordings)
    fits = {**dict.fromkeys(best.values, best), **others}

    def held_against(name: str, fit: FallFit) -> MeasuredEffect:
        return _measured(name, fit, halves, checks, recordings)

    found = [held_against(name, fit) for name, fit in fits.items()]
    return [
        replace(each, alike=tuple(held_against(*other) for other in _alike(each, fits, halves).items()))
        for each in found
    ]


def _alike(shown: MeasuredEffect, fits: Mapping[str, FallFit], halves: HalvesOfFalls) -> dict[str, FallFit]:
    """Effects that explain what one that shows does, and the fits in which they take its place: those that are one
    thing with it, and those that gain about as much."""
    if not shown.shows:
        return {}
    traits, fit = effect_named(shown.name).traits, fits[shown.name]
    rest = tuple(name for name in fit.values if name != shown.name)
    others = {name: _fit(halves, (*rest, name)) for name in fits if name not in fit.values}
    same = traits.equivalent_to if traits.is_horizontal(shown.values) else ()
    needed = _worth(halves, fit) - RIVAL_GAIN
    return {name: other for name, other in others.items() if name in same or _worth(halves, other) >= needed}


def fall_limits(
    names: Sequence[str], observations: Sequence[TrackedEpisode], *, lies_flat: bool, needed: float
) -> list[DetectionLimit]:
    """The limit of every size of some effects in the falls of episodes; nothing without a fall.

    Args:
        needed: gain in log-likelihood from which an effect shows.
    """
    halves = _halves_of_falls(observations, lies_flat=lies_flat)
    if halves is None:
        return []

    def gain(effect: Effect, size: str, off: float) -> float:
        values = {each.name: each.null or 0.0 for each in effect.parameters}
        values[size] += off
        return float(np.sum(halves.whitened(_motion({effect.name: values})) ** 2) / 4.0)

    return size_limits(names, gain, needed=needed, one_thing=True)


def measured_by_falls(names: Collection[str]) -> list[str]:
    """Those of some effects that falls tell."""
    return [name for name in names if Measurement.FREE_FALL in effect_named(name).traits.measured_by]


def _halves_of_falls(observations: Sequence[TrackedEpisode], *, lies_flat: bool) -> HalvesOfFalls | None:
    """Those of all falls of episodes that tell enough; None without one."""
    falls = [each for one in observations for each in falls_in(one, lies_flat=lies_flat)]
    if not falls:
        return None
    motions = np.concatenate([each.motions for each in falls])
    noise = np.concatenate([each.covariances for each in falls])
    whitening = np.linalg.inv(np.linalg.cholesky(noise + np.diag(SPREAD**2)))
    if not lies_flat:
        return HalvesOfFalls(motions=motions, whitening=whitening)
    told = (np.linalg.norm(whitening[:, :, :3], axis=1) >= 1.0 / LEAST_TOLD).all(axis=1)
    chosen = np.flatnonzero(np.repeat(told.reshape(-1, 2).all(axis=1), 2))
    return HalvesOfFalls(motions=motions[chosen], whitening=whitening[chosen]) if len(chosen) else None


def _motion(values: Values) -> np.ndarray:
    """[5] by how much something with effects falls otherwise than freely."""
    moved = [effect_named(name).falls(dict(own)) - FREELY for name, own in values.items()]  # type: ignore[misc]
    return np.asarray(sum(moved, np.zeros(5)))


def _fit(halves: HalvesOfFalls, names: Sequence[str]) -> FallFit:
    """Effects fitted together to falls."""
    parameters = [(name, each) for name in names for each in effect_named(name).parameters]

    def named(numbers: np.ndarray) -> dict[str, dict[str, float]]:
        found: dict[str, dict[str, float]] = {name: {} for name in names}
        for (name, parameter), value in zip(parameters, numbers, strict=True):
            found[name][parameter.name] = float(value)
        return found

    if not parameters:
        return FallFit(values={}, widths={})
    bounds = np.array([(each.low, each.high) for _, each in parameters]).T
    null = np.array([each.null or 0.0 for _, each in parameters])
    steps = np.array([each.step for _, each in parameters])
    start = np.clip(null + 0.1 * steps, *bounds)

    def left(numbers: np.ndarray) -> np.ndarray:
        # Two halves are one fall.
        return np.ravel(halves.left(named(numbers))) / np.sqrt(2.0)

    found = least_squares(left, start, bounds=bounds, x_scale=steps)
    covariance = np.linalg.pinv(found.jac.T @ found.jac)
    return FallFit(
        values=named(found.x),
        widths=named(np.sqrt(np.maximum(np.diag(covariance), 0.0))),
    )


def _selected(
    halves: HalvesOfFalls, names: Sequence[str], recordings: Recordings
) -> tuple[FallFit, dict[str, FallFit]]:
    """Forward selection: the fit with one effect after the other as long as one gains, and those with one more each."""
    needed, best = recordings.thresholds.measured_gain, _fit(halves, ())
    while left := [name for name in names if name not in best.values]:
        others = {name: _fit(halves, (*best.values, name)) for name in left}
        enough = [fit for fit in others.values() if float(halves.gains(best.values, fit.values).sum()) >= needed]
        if not enough:
            return best, others
        best = max(enough, key=lambda fit: _worth(halves, fit))
    return best, {}


def _worth(halves: HalvesOfFalls, fit: FallFit) -> float:
    """What a fit gains over none, less what so many parameters gain anyway: of a general effect and a special case that
    explains as much the special case is taken."""
    return float(halves.gains({}, fit.values).sum()) - PARAMETER_GAIN * sum(map(len, fit.values.values()))


def _measured(
    name: str,
    fit: FallFit,
    halves: HalvesOfFalls,
    validation: HalvesOfFalls | None,
    recordings: Recordings,
) -> MeasuredEffect:
    """One of the effects that falls were fitted with, held against the same fit without it."""
    effect, rest = effect_named(name), tuple(each for each in fit.values if each != name)
    without = _fit(halves, rest).values
    held_out, count = [], len(halves.motions)
    for out in halves.left_out():
        others = halves.taken(np.delete(np.arange(count), out))
        before, after = (_fit(others, each).values for each in (rest, (*rest, name)))
        held_out.append(float(halves.gains(before, after)[out].sum()))
    fitted = float(halves.gains(without, fit.values).sum())
    also = (*effect.traits.equivalent_to, *effect.traits.equivalent_in_air)
    general = [each for each in general_forms(name) if not effect_named(each).falls]
    falls = count // 2
    fell = FREELY + USUAL_AIR + _motion(fit.values)
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
        validation_gain=None if validation is None else float(validation.gains(without, fit.values).sum()),
        p_null=float(chi2.sf(2.0 * fitted, len(effect.parameters))),
        reason=f"{name} is measured in {falls} falls: it falls by "
        f"({', '.join(f'{value:.2f}' for value in fell[:3])}) m/s^2, and air takes {max(fell[3], 0.0):.1f} 1/m of its "
        "speed squared"
        + (f"; it carries {fell[4]:.2f} of its mass in air" if fell[4] > 0.0 else "")
        + (f", as it would by {' or '.join(also)}" if also else "")
        + (
            f"; one fall does not tell it from {' or '.join(general)}: let it fall elsewhere and later, too"
            if falls == 1 and general
            else ""
        ),
        thresholds=recordings.thresholds,
        chance="chance of such a gain where it does not act",
        left_out="a fall left out as a whole" if falls > 1 else "a half of the tracks, left out",
    )


def _interval(value: float, width: float) -> tuple[float, float]:
    return value - 1.96 * width, value + 1.96 * width
