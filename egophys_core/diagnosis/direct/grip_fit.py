"""What grips say of the record of the hands: it is early, too small or too large, or the object slips through them.

The tracks in a hand leave its recorded path by what these effects make of it, and by little else: the mechanics of the
object cancels. Their parameters are fitted to all grips together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from egophys_core.diagnosis.direct.grips import GripRecord, held, held_displacements, residual_of
from egophys_core.diagnosis.direct.surrogates import shifted_p
from egophys_core.effects import Parameter, effect_named

FLOOR = 1e-3
"""Metres of residual that held tracks have anyway: skin and cloth give."""

CORRELATED_S = 0.5
"""Seconds over which residuals of tracks are alike."""

ONSETS = 6
"""Times at which the search for an effect starts that begins at some time."""

STEPS, CHOICES = 15, 4
"""Of Levenberg-Marquardt while the same tracks are held, and times that these are chosen anew."""

FINITE_DIFFERENCE_STEP = 0.1
"""Of a parameter's step, for slopes; a descent starts as far off no effect, as a slip of no speed has no onset."""

Parameters = Mapping[str, Mapping[str, float]]
"""Parameters by effect and name."""


@dataclass(frozen=True, kw_only=True)
class GripFit:
    """Grips with the parameters of some effects."""

    values: Parameters
    squares: np.ndarray
    """[G] mean square of the held tracks' residual in each grip, m^2 per axis."""
    tracks: list[np.ndarray]
    """The tracks held in each grip."""


def explained(grips: Sequence[GripRecord], values: Parameters) -> GripFit:
    """How well given parameters explain grips."""
    found = [held(grip, _residual(grip, values)) for grip in grips]
    return GripFit(values=values, squares=np.array([each for _, each in found]), tracks=[each for each, _ in found])


def fit_grips(grips: Sequence[GripRecord], names: Sequence[str]) -> GripFit:
    """The parameters of some effects that explain grips best."""
    begins, ends = min(grip.times[0] for grip in grips), max(grip.times[-1] for grip in grips)
    begin_at_some_time = any(_is_time(each) for name in names for each in effect_named(name).parameters)
    onsets = np.linspace(begins, ends, ONSETS if begin_at_some_time else 1, endpoint=False)
    fits = [_descend(grips, names, float(onset)) for onset in onsets]
    return min(fits, key=lambda fit: float(_counts(grips) @ np.log(fit.squares + FLOOR**2)))


def gains(grips: Sequence[GripRecord], before: GripFit, after: GripFit) -> np.ndarray:
    """[G] gain in log-likelihood in each grip."""
    return _counts(grips) / 2.0 * np.log((before.squares + FLOOR**2) / (after.squares + FLOOR**2))


def p_null(grips: Sequence[GripRecord], before: GripFit, after: GripFit, *, seed: int) -> float:
    """Share of surrogates that gain as much: what the effect changes in held tracks, shifted in time, in any size."""
    errors, changes = [], []
    for grip, tracks in zip(grips, after.tracks, strict=True):
        error = _residual(grip, before.values)[:, tracks]
        errors.append(error)
        changes.append(error - _residual(grip, after.values)[:, tracks])
    return shifted_p(errors, changes, _counts(grips), [grip.seconds for grip in grips], floor=FLOOR, seed=seed)


def intervals(
    grips: Sequence[GripRecord], fit: GripFit, *, resamples: int, seed: int
) -> dict[str, dict[str, tuple[float, float]]]:
    """The 95 % intervals of the parameters of a fit, over resampled grips and stretches of them."""
    vector = _Vector(tuple(fit.values), grips)
    at = vector.of(fit.values)
    rows = _unexplained(grips, fit, fit.values)
    slopes = [
        [(ahead - behind) / (2.0 * FINITE_DIFFERENCE_STEP) for ahead, behind in zip(*both, strict=True)]
        for step in FINITE_DIFFERENCE_STEP * np.eye(len(at))
        for both in [[_unexplained(grips, fit, vector.values(at + sign * step)) for sign in (1.0, -1.0)]]
    ]
    matrices, vectors = [], []
    for index, (grip, error) in enumerate(zip(grips, rows, strict=True)):
        count = max(1, round(grip.seconds / CORRELATED_S))
        jacobian = np.stack([slope[index] for slope in slopes], axis=-1)
        for stretch in np.array_split(np.arange(len(error)), count):
            part = jacobian[stretch].reshape(-1, len(at))
            matrices.append(part.T @ part)
            vectors.append(part.T @ error[stretch].ravel())
    random = np.random.default_rng(seed)
    drawn = random.integers(0, len(matrices), size=(resamples, len(matrices)))
    prior = 1e-6 * np.eye(len(at))
    steps = np.array(
        [
            -np.linalg.solve(
                np.sum([matrices[each] for each in row], axis=0) + prior,
                np.sum([vectors[each] for each in row], axis=0),
            )
            for row in drawn
        ]
    )
    ends = at + np.quantile(steps - np.median(steps, axis=0), [0.025, 0.975], axis=0)
    low, high = (vector.values(np.clip(end, vector.low, vector.high)) for end in ends)
    return {name: {each: (low[name][each], high[name][each]) for each in low[name]} for name in low}


class _Vector:
    """The parameters of effects as one vector, in steps of their parameters."""

    def __init__(self, names: Sequence[str], grips: Sequence[GripRecord]) -> None:
        self.parameters = [(name, each) for name in names for each in effect_named(name).parameters]
        self.steps = np.array([each.step for _, each in self.parameters])
        # Far from the truth a clock's residual has other minima: one for every time that a hand turns back.
        self.late = float(np.median([grip.delay for grip in grips]))
        # A time is one at which something is held.
        begins, ends = min(grip.times[0] for grip in grips), max(grip.times[-1] for grip in grips)
        bounds = [(begins, ends) if _is_time(each) else (each.low, each.high) for _, each in self.parameters]
        self.low, self.high = np.array(bounds).T / self.steps

    def values(self, place: np.ndarray) -> dict[str, dict[str, float]]:
        found: dict[str, dict[str, float]] = {}
        for (name, each), value in zip(self.parameters, place * self.steps, strict=True):
            found.setdefault(name, {})[each.name] = float(value)
        return found

    def of(self, values: Parameters) -> np.ndarray:
        return np.array([values[name][each.name] for name, each in self.parameters]) / self.steps

    def _start(self, name: str, parameter: Parameter, onset: float) -> float:
        if effect_named(name).clock:
            return self.late
        return onset if parameter.null is None else parameter.null

    def start(self, onset: float) -> np.ndarray:
        null = np.array([self._start(name, each, onset) for name, each in self.parameters])
        return np.clip(null / self.steps + FINITE_DIFFERENCE_STEP, self.low, self.high)


def _descend(grips: Sequence[GripRecord], names: Sequence[str], onset: float) -> GripFit:
    """Down to the nearest optimum from an onset; which tracks are held is chosen anew as it goes."""
    vector = _Vector(names, grips)
    place = vector.start(onset)
    for _ in range(CHOICES):
        chosen = explained(grips, vector.values(place))

        def errors(at: np.ndarray, chosen: GripFit = chosen) -> np.ndarray:
            return np.concatenate([each.ravel() for each in _unexplained(grips, chosen, vector.values(at))])

        place = least_squares(errors, place, bounds=(vector.low, vector.high), max_nfev=STEPS).x
    return explained(grips, vector.values(place))


def _unexplained(grips: Sequence[GripRecord], chosen: GripFit, values: Parameters) -> list[np.ndarray]:
    """Per grip [F, HELD_TRACKS, 3]: residuals of chosen tracks; their squares are to sum up to `_counts`."""
    found = []
    for grip, tracks, square, count in zip(grips, chosen.tracks, chosen.squares, _counts(grips), strict=True):
        error = _residual(grip, values)[:, tracks]
        found.append(np.sqrt(count / error.size / (square + FLOOR**2)) * error)
    return found


def _counts(grips: Sequence[GripRecord]) -> np.ndarray:
    """[G] how many independent values each grip holds."""
    return np.array([3.0 * grip.seconds / CORRELATED_S for grip in grips])


def _residual(grip: GripRecord, values: Parameters) -> np.ndarray:
    """[F, P, 3] metres: what the tracks leave of how held ones go with these effects."""
    return residual_of(grip, held_displacements(grip, values))


def _is_time(parameter: Parameter) -> bool:
    """Whether a parameter says from when on an effect acts."""
    return parameter.null is None and parameter.unit == "s"
