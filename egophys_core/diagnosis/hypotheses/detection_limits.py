"""Detection limits: how large an effect would have had to be for some recordings to name it, and beside what.

An effect of a size is put into the residuals that the recordings left, as its slopes have it, and it is asked what a
fit with it would gain on left-out data. So the limit grows with what the twin misses anyway, with noise, and with how
much of the effect the object's own parameters can take up. How much that is slopes do not say: at the size that they
give the twin is refitted, and the limit is moved to where that gains what is needed (docs/notes/experiments.md).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.evidence.fitted_parameters import effect_parameter
from egophys_core.diagnosis.evidence.linear_problem import (
    Columns,
    LinearProblem,
    baseline_columns,
    fitted_gain,
    left_out_losses,
)
from egophys_core.diagnosis.evidence.refit import CORRELATED, PRIOR_STEPS
from egophys_core.diagnosis.hypotheses.attained_gain import InjectedEffect
from egophys_core.diagnosis.hypotheses.ranking import Probe
from egophys_core.diagnosis.least_size import Look, corrected_shares, least_share

NARROWINGS = 7
"""Bisections of a limit: from a range of a thousand to some percent."""

ALIKE_SHARE = 0.9
"""Of what an effect at its limit leaves in the residuals: what another takes up of it makes both look alike."""


Attained = Callable[[Sequence[InjectedEffect]], Sequence[float | None]]
"""The gains of effects after refits of the twin without them; None where unknown."""


@dataclass(frozen=True, kw_only=True)
class _Way:
    """One size of an effect, to the side that shows it less."""

    size: str
    end: float
    """Steps from null to its bound there."""
    share: float | None
    """Of these from which it gains what is needed; None where it never does."""


def detection_limits(
    problem: LinearProblem, probes: Sequence[Probe], *, needed_gain: float, attained: Attained | None = None
) -> tuple[DetectionLimit, ...]:
    """The limit of every size of every effect, of several starts of an effect that of the middle one.

    Args:
        problem: the linear problem at the twin that the probes' slopes are of.
        probes: what effects do to the residuals, at all of their starts.
        needed_gain: in log-likelihood, on data that are left out.
        attained: what refits say; without, slopes alone count.
    """
    typical = {name: _middle_start(problem, group) for name, group in _by_effect(probes).items()}
    columns = {name: each.columns(problem.column(each.slopes)) for name, each in typical.items()}
    # What it seems to explain of residuals that lack it says how well the twin's mismatch passes for it.
    needed = {name: needed_gain + max(_gain_of(problem, each, 0, 0.0), 0.0) for name, each in columns.items()}
    left = {name: _beside_baseline(problem, each.values) for name, each in columns.items()}
    ways = {
        name: [_way(problem, columns[name], index, size, needed[name]) for index, size in enumerate(probe.sizes)]
        for name, probe in typical.items()
    }
    if attained is not None:
        ways |= _moved(ways, typical, needed, attained)
    found = []
    for name, probe in typical.items():
        for index, way in enumerate(ways[name]):
            parameter = effect_parameter(probe.effect, way.size)
            definition = parameter.definition
            assert definition.null is not None  # else it would say no size
            steps = 0.0 if way.share is None else way.share * way.end
            there = parameter.value_at(parameter.position_of(probe.null[way.size]) + steps)
            found.append(
                DetectionLimit(
                    effect=name,
                    parameter=way.size,
                    unit=definition.unit,
                    null=definition.null,
                    size=None if way.share is None else abs(there - definition.null),
                    alike=() if way.share is None else _alike(name, left[name][:, index], left),
                )
            )
    return tuple(found)


def _moved(
    ways: Mapping[str, Sequence[_Way]], probes: Mapping[str, Probe], needed: Mapping[str, float], attained: Attained
) -> dict[str, list[_Way]]:
    """The limits moved to where refits attain what is needed: by as much as that of the size that shows least.

    Of sizes that slopes say never show, only one that is alone is looked for: to its bound.
    """
    least = {name: max(group, key=lambda each: each.share or 0.0) for name, group in ways.items() if group}
    names = [name for name, way in least.items() if way.share is not None or len(ways[name]) == 1]

    def gains(looks: Mapping[int, Look]) -> dict[int, float | None]:
        injected = []
        for index, look in looks.items():
            way, probe = least[names[index]], probes[names[index]]
            steps = look.share * way.end
            injected.append(InjectedEffect(probe=probe, size=way.size, steps=steps, needed_gain=look.needed))
        return dict(zip(looks, attained(injected), strict=True))

    first = [Look(share=1.0 if (share := least[name].share) is None else share, needed=needed[name]) for name in names]
    found = {}
    for name, look, share in zip(names, first, corrected_shares(gains, first), strict=True):
        by = None if share is None else share / look.share
        alone = least[name].share is None
        found[name] = [replace(way, share=_times(1.0 if alone else way.share, by)) for way in ways[name]]
    return found


def _times(share: float | None, by: float | None) -> float | None:
    """A share moved, None beyond the bound."""
    return None if share is None or by is None or share * by > 1.0 else share * by


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


def _way(problem: LinearProblem, columns: Columns, index: int, size: str, needed_gain: float) -> _Way:
    """One size of an effect, to whichever side shows it less, by slopes."""
    ends = [float(end) for end in (columns.low[index], columns.high[index]) if end]
    ways = [_Way(size=size, end=end, share=_least_share(problem, columns, index, end, needed_gain)) for end in ends]
    return max(ways, key=lambda each: np.inf if each.share is None else abs(each.share * each.end))


def _least_share(problem: LinearProblem, columns: Columns, index: int, end: float, needed_gain: float) -> float | None:
    """Of the steps to one bound, the share from which it gains as much as is needed; None where it never does."""
    return least_share(lambda part: _gain_of(problem, columns, index, part * end), needed_gain, narrowings=NARROWINGS)


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
