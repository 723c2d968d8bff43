"""Detection limits: how large an effect would have had to be for some recordings to name it, and beside what.

An effect of a size is put into the residuals that the recordings left, as its slopes have it, and it is asked what a
fit with it would gain on left-out data. So the limit grows with what the twin misses anyway, with noise, and with how
much of the effect the object's own parameters can take up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.evidence.fitted_parameters import effect_parameters
from egophys_core.diagnosis.evidence.linear_problem import (
    Columns,
    LinearProblem,
    baseline_columns,
    fitted_gain,
    left_out_losses,
)
from egophys_core.diagnosis.evidence.refit import CORRELATED, PRIOR_STEPS
from egophys_core.diagnosis.hypotheses.ranking import Probe
from egophys_core.diagnosis.least_size import least_share

NARROWINGS = 7
"""Bisections of a limit: from a range of a thousand to some percent."""

ALIKE_SHARE = 0.9
"""Of what an effect at its limit leaves in the residuals: what another takes up of it makes both look alike."""


def detection_limits(
    problem: LinearProblem, probes: Sequence[Probe], *, needed_gain: float
) -> tuple[DetectionLimit, ...]:
    """The limit of every size of every effect, of several starts of an effect that of the middle one.

    Args:
        problem: the linear problem at the twin that the probes' slopes are of.
        probes: what effects do to the residuals, at all of their starts.
        needed_gain: in log-likelihood, on data that are left out.
    """
    typical = {name: _middle_start(problem, group) for name, group in _by_effect(probes).items()}
    columns = {name: each.columns(problem.column(each.slopes)) for name, each in typical.items()}
    # What it seems to explain of residuals that lack it says how well the twin's mismatch passes for it.
    needed = {name: needed_gain + max(_gain_of(problem, each, 0, 0.0), 0.0) for name, each in columns.items()}
    left = {name: _beside_baseline(problem, each.values) for name, each in columns.items()}
    found = []
    for name, probe in typical.items():
        for index, size in enumerate(probe.sizes):
            parameter = next(each for each in effect_parameters(probe.effect) if each.definition.name == size)
            definition = parameter.definition
            assert definition.null is not None  # else it would say no size
            steps = _least_steps(problem, columns[name], index, needed[name])
            there = parameter.value_at(parameter.position_of(probe.null[size]) + (steps or 0.0))
            found.append(
                DetectionLimit(
                    effect=name,
                    parameter=size,
                    unit=definition.unit,
                    null=definition.null,
                    size=None if steps is None else abs(there - definition.null),
                    alike=() if steps is None else _alike(name, left[name][:, index], left),
                )
            )
    return tuple(found)


def _by_effect(probes: Sequence[Probe]) -> Mapping[str, list[Probe]]:
    found: dict[str, list[Probe]] = {}
    for each in probes:
        found.setdefault(each.effect.name, []).append(each)
    return found


def _middle_start(problem: LinearProblem, probes: Sequence[Probe]) -> Probe:
    """Of an effect's starts the one that shows neither most nor least."""
    shown = [np.linalg.norm(_beside_baseline(problem, problem.column(each.slopes))) for each in probes]
    return probes[int(np.argsort(shown)[len(shown) // 2])]


def _beside_baseline(problem: LinearProblem, values: np.ndarray) -> np.ndarray:
    """[M, C] slopes over the residuals' spread, without what the object's own parameters take up."""
    root = np.sqrt(2.0 / (problem.scale**2 + problem.residual**2) / CORRELATED)[:, None]
    own, slopes = root * problem.baseline, root * values
    prior = np.eye(own.shape[1]) / PRIOR_STEPS**2
    return np.asarray(slopes - own @ np.linalg.solve(own.T @ own + prior, own.T @ slopes))


def _least_steps(problem: LinearProblem, columns: Columns, index: int, needed_gain: float) -> float | None:
    """Steps of one size, to whichever side shows it less, from which it gains as much as is needed."""
    ends = [end for end in (columns.low[index], columns.high[index]) if end]
    sides = [_least_steps_towards(problem, columns, index, end, needed_gain) for end in ends]
    if not sides or any(each is None for each in sides):
        return None
    return max((each for each in sides if each is not None), key=abs)


def _least_steps_towards(
    problem: LinearProblem, columns: Columns, index: int, end: float, needed_gain: float
) -> float | None:
    """The same to one side, up to a bound; None where it does not gain that much there."""
    share = least_share(lambda part: _gain_of(problem, columns, index, part * end), needed_gain, narrowings=NARROWINGS)
    return None if share is None else end * share


def _gain_of(problem: LinearProblem, columns: Columns, index: int, steps: float) -> float:
    """What an effect would gain in recordings of a world that had it in a size, the lesser on fitted and left-out data.

    The columns say what the effect takes off the residuals of such a world.
    """
    injected = replace(problem, residual=problem.residual - steps * columns.values[:, index])
    # One stretch of all episodes together is left out at a time, which takes as many fits less.
    stretches = problem.fold % (problem.fold[problem.episode == 0].max() + 1)
    baseline = baseline_columns(problem)
    known, left = (left_out_losses(injected, each, stretches).sum() for each in (baseline, baseline.beside(columns)))
    return min(float(known - left), fitted_gain(injected, columns))


def _alike(name: str, shown: np.ndarray, left: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    """Other effects whose slopes take up most of what an effect shows [M]."""
    found = []
    for other, slopes in left.items():
        if other == name or not slopes.size:
            continue
        steps = np.linalg.lstsq(slopes, shown, rcond=None)[0]
        if np.sum((slopes @ steps) ** 2) >= ALIKE_SHARE * np.sum(shown**2):
            found.append(other)
    return tuple(found)
