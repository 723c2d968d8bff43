"""How level the table is in the tracking frame: a sheet that lies flat on it tells, whatever it is made of."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.direct.measured import MeasuredEffect, Recordings, measured
from egophys_core.effects import Effect, effect_named
from egophys_core.effects.rotations import rotation

FLAT_M = 0.003
"""Metres, root mean square, by which tracks of a sheet that lies flat leave a plane at most."""

FEWEST_TRACKS = 10

FLOOR = 1e-3
"""Metres by which a flat sheet leaves a plane anyway: folds and noise."""

PLACES = 12.0
"""Heights that a sheet at rest tells independently."""

SURROGATES = 200
"""Frames that lean as much in other directions."""


def table_level_effects(names: Sequence[str], recordings: Recordings) -> list[MeasuredEffect]:
    """The tilt of the frame by each of the effects that rotate it, where the object lies flat in every episode."""
    if not recordings.lies_flat or recordings.fitted[0].free:
        return []
    rests = [each.rest for each in recordings.fitted]
    normals = [normal for rest in rests if (normal := upward(rest)) is not None]
    if len(normals) < len(rests):
        return []
    return [_frame_effect(effect_named(name), rests, normals, recordings) for name in names]


def upward(rest: np.ndarray) -> np.ndarray | None:
    """[3] normal of the plane in which a sheet lies whose tracks rest at [P, 3] metres; None where it is not flat."""
    if len(rest) < FEWEST_TRACKS:
        return None
    centred = rest - rest.mean(axis=0)
    slope, *_ = np.linalg.lstsq(centred[:, :2], centred[:, 2], rcond=None)
    if np.mean((centred[:, 2] - centred[:, :2] @ slope) ** 2) > FLAT_M**2:
        return None
    normal = np.array([-slope[0], -slope[1], 1.0])
    return normal / np.linalg.norm(normal)


def frame_values(effect: Effect, normal: np.ndarray) -> np.ndarray:
    """[D] parameters of an effect whose frame rotates upright to a normal [3]."""
    parameters = effect.parameters
    bounds = np.array([(each.low, each.high) for each in parameters]).T
    start = np.array([each.null or 0.0 for each in parameters])

    def off(values: np.ndarray) -> np.ndarray:
        return _frame(effect, values)[:, 2] - normal

    return np.asarray(least_squares(off, start, bounds=bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12).x)


def level_gain(rest: np.ndarray, frame: np.ndarray) -> float:
    """Gain in log-likelihood of a frame [3, 3] over a level one, by tracks [P, 3] of a sheet at rest."""
    upright = rest @ frame
    return float(PLACES / 2.0 * np.log((rest[:, 2].var() + FLOOR**2) / (upright[:, 2].var() + FLOOR**2)))


def _frame_effect(
    effect: Effect, rests: Sequence[np.ndarray], normals: Sequence[np.ndarray], recordings: Recordings
) -> MeasuredEffect:
    """One effect on the frame, by sheets at rest and their normals."""
    found = np.array([frame_values(effect, normal) for normal in normals])
    mean, count = found.mean(axis=0), len(found)
    frame = _frame(effect, mean)
    fitted = sum(level_gain(rest, frame) for rest in rests)
    others = [_frame(effect, (found.sum(axis=0) - own) / (count - 1)) for own in found]
    validation = sum(level_gain(each.rest, frame) for each in recordings.validation) if recordings.validation else None
    angles = np.random.default_rng(recordings.seed).uniform(0.0, 2.0 * np.pi, SURROGATES)
    surrogates = np.array([sum(level_gain(rest, each) for rest in rests) for each in _leaning(frame, angles)])
    width = stdtrit(count - 1, 0.975) * found.std(axis=0, ddof=1) / np.sqrt(count)
    return measured(
        effect.name,
        parameters={
            each.name: Estimate(value=float(value), unit=each.unit, ci95=(float(value - wide), float(value + wide)))
            for each, value, wide in zip(effect.parameters, mean, width, strict=True)
        },
        fitted_gain=float(fitted),
        held_out_gains=[level_gain(rest, other) for rest, other in zip(rests, others, strict=True)],
        validation_gain=validation,
        p_null=float((1 + np.sum(surrogates >= fitted)) / (1 + SURROGATES)),
        reason=f"{effect.name} is measured at rest: the sheet lies "
        f"{np.degrees(np.arccos(np.clip(frame[2, 2], -1.0, 1.0))):.1f} degrees aslant in all {count} episodes",
        thresholds=recordings.thresholds,
    )


def _frame(effect: Effect, values: np.ndarray) -> np.ndarray:
    """[3, 3] the frame of an effect with parameters [D]; level if it has none."""
    named: Mapping[str, float] = {
        each.name: float(value) for each, value in zip(effect.parameters, values, strict=True)
    }
    return effect.frame(dict(named)) if effect.frame else np.eye(3)


def _leaning(frame: np.ndarray, angles: np.ndarray) -> list[np.ndarray]:
    """A frame [3, 3] rotated so that it tilts about horizontal axes at angles [S], rad."""
    axis = np.arctan2(frame[0, 2], -frame[1, 2])
    about_upright = [rotation(np.array([0.0, 0.0, angle - axis])) for angle in angles]
    return [turn @ frame @ turn.T for turn in about_upright]
