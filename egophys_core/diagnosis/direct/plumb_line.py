"""Where plumb lines point in the tracking frame: a sheet that hangs at rest from two places tells, whatever it weighs.

It hangs in the plane through those, so only a lean out of that shows in one record.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.direct.measured import MeasuredEffect, Recordings, measured
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import Effect, effect_named
from egophys_core.simulation import ContactKind

FEWEST_TRACKS = 10

STILL_S = 0.5
"""Seconds for which hands hold it still at least: what begins in motion hangs aslant for that."""

WIDE_M = 0.1
"""Metres between the two places, along the table, at least."""

FLAT_M = 0.01
"""Metres, root mean square, by which tracks leave a plane at most; recorded cloth leaves it by 3 to 4 mm."""

LEANS_ANYWAY = 0.008
"""Radians (standard deviation) by which a sheet hangs off a plumb line anyway, for its folds and how it is held: in six
records of one cloth, which hung 0.025 to 0.043 aslant, it was 0.007."""

LEANS = 0.1
"""Radians (standard deviation) by which frames of records lean: what shows nothing of a direction is upright in it."""

SURROGATES = 200
"""Plumb lines that lean as much in other directions."""


def plumb_line_effects(names: Sequence[str], recordings: Recordings) -> list[MeasuredEffect]:
    """How gravity points by each of the effects that tilt it, where a sheet hangs at rest in every episode."""
    if not recordings.lies_flat:
        return []
    leans = [found for each in recordings.fitted if (found := lean(each)) is not None]
    if len(leans) < len(recordings.fitted):
        return []
    validation = [found for each in recordings.validation if (found := lean(each)) is not None]
    return [_tilt_effect(effect_named(name), leans, validation, recordings) for name in names]


def lean(observation: TrackedEpisode) -> np.ndarray | None:
    """[3] metres aside per metre down, horizontal and out of its plane, by which a sheet hangs; None where that does
    not show."""
    rest, episode, observed = observation.rest, observation.episode, observation.observed
    is_still = episode.times[observed.still - 1] >= STILL_S
    if not (observed.hangs and is_still) or len(rest) < FEWEST_TRACKS:
        return None
    places = episode.controllers[observed.touched, observed.contact[observed.touched] == ContactKind.HOLD]
    apart = (places[:, None] - places[None]).astype(np.float64).reshape(-1, 3)
    along = apart[np.argmax(np.linalg.norm(apart[:, :2], axis=1))] * [1.0, 1.0, 0.0]
    if np.linalg.norm(along) < WIDE_M:
        return None
    normal = np.array([-along[1], along[0], 0.0]) / np.linalg.norm(along)
    down, aside = rest[:, 2].mean() - rest[:, 2], rest @ normal
    slope = np.polyfit(down, aside, 1)[0]
    return slope * normal if np.std(aside - slope * down) <= FLAT_M else None


def tilt_values(effect: Effect, leans: Sequence[np.ndarray]) -> np.ndarray:
    """[D] parameters of an effect whose plumb line leans so [3] in each record, and little beside that."""
    bounds = np.array([(each.low, each.high) for each in effect.parameters]).T
    start = np.array([each.null or 0.0 for each in effect.parameters])

    def off(values: np.ndarray) -> np.ndarray:
        plumb = _plumb(effect, values)
        return np.array([*(_beside(each, plumb) for each in leans), *(LEANS_ANYWAY / LEANS * (values - start))])

    return np.asarray(least_squares(off, start, bounds=bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12).x)


def lean_gain(leaning: np.ndarray, plumb: np.ndarray) -> float:
    """Gain in log-likelihood of a plumb line [3] over an upright one, by how [3] a sheet hangs."""
    return float((leaning @ leaning - _beside(leaning, plumb) ** 2) / (2.0 * LEANS_ANYWAY**2))


def _beside(leaning: np.ndarray, plumb: np.ndarray) -> float:
    """Radians by which a sheet that hangs so [3] is off a plumb line [3], out of its plane."""
    size = float(np.linalg.norm(leaning))
    return size - float(leaning @ plumb) / (size * -plumb[2]) if size else 0.0


def _tilt_effect(
    effect: Effect, leans: Sequence[np.ndarray], validation: Sequence[np.ndarray], recordings: Recordings
) -> MeasuredEffect:
    """One effect on the direction of gravity, by how sheets hang at rest."""
    values, count = tilt_values(effect, leans), len(leans)
    plumb = _plumb(effect, values)
    others = [_plumb(effect, tilt_values(effect, [*leans[:index], *leans[index + 1 :]])) for index in range(count)]
    fitted = sum(lean_gain(each, plumb) for each in leans)
    angles = np.random.default_rng(recordings.seed).uniform(0.0, 2.0 * np.pi, SURROGATES)
    surrogates = np.array([sum(lean_gain(each, turned) for each in leans) for turned in _turned(plumb, angles)])
    alone = np.array([tilt_values(effect, [each]) for each in leans])
    width = stdtrit(count - 1, 0.975) * alone.std(axis=0, ddof=1) / np.sqrt(count)
    also = effect.traits.equivalent_in_air
    return measured(
        effect.name,
        parameters={
            each.name: Estimate(value=float(value), unit=each.unit, ci95=(float(value - wide), float(value + wide)))
            for each, value, wide in zip(effect.parameters, values, width, strict=True)
        },
        fitted_gain=fitted,
        held_out_gains=[lean_gain(own, other) for own, other in zip(leans, others, strict=True)],
        validation_gain=sum(lean_gain(each, plumb) for each in validation) if validation else None,
        p_null=float((1 + np.sum(surrogates >= fitted)) / (1 + SURROGATES)),
        reason=f"{effect.name} is measured at rest: the sheet hangs "
        f"{np.degrees(np.arccos(np.clip(-plumb[2], -1.0, 1.0))):.1f} degrees aslant in all {count} episodes"
        + (f", as it would by {' or '.join(also)}" if also else ""),
        thresholds=recordings.thresholds,
    )


def _plumb(effect: Effect, values: np.ndarray) -> np.ndarray:
    """[3] the plumb line of an effect with parameters [D]; upright if it has none."""
    named = {each.name: float(value) for each, value in zip(effect.parameters, values, strict=True)}
    return effect.plumb(named) if effect.plumb else np.array([0.0, 0.0, -1.0])


def _turned(plumb: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """[S, 3] plumb lines that lean as much as one [3] in other directions, rad [S]."""
    size = np.hypot(plumb[0], plumb[1])
    return np.stack([size * np.cos(angles), size * np.sin(angles), np.full(len(angles), plumb[2])], axis=1)
