"""Leaps: what an effect gains far from the twin as it is.

A twin that lacks an effect has bent to make up for it. Slopes there tell the effect's direction, but far too small a
size, or none; with the effect at several times the size, and the base turned back along its own slopes, it may explain
much (docs/notes/discrepancy.md).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import at_null, part_way, with_effect
from egophys_core.diagnosis.evidence.linear_problem import LinearProblem, base_columns, left_out_losses
from egophys_core.diagnosis.evidence.residuals import Observation, residuals
from egophys_core.diagnosis.hypotheses.ranking import Ranked
from egophys_core.effects import Effect
from egophys_core.twin import ObjectModel

LEAPS = (-3.0, 3.0, 9.0)
"""Times the size at which the search for an effect starts."""

LEAPT = 2
"""Starts of each effect, the best by their slopes, that are leapt from to rank it."""


def leapt(model: ObjectModel, effect: Effect, start: Mapping[str, float]) -> list[ObjectModel]:
    """A model without the effect, with it at each of the leaps that does not end at its bound where it vanishes."""
    values = [part_way(effect, start, share) for share in LEAPS]
    return [with_effect(model, effect.name, each) for each in values if each != at_null(effect, each)]


def there_and_beyond(model: ObjectModel, effect: Effect, start: Mapping[str, float]) -> list[ObjectModel]:
    """A model without the effect, with it at a start and at each of the leaps from there."""
    return [with_effect(model, effect.name, dict(start)), *leapt(model, effect, start)]


@dataclass(frozen=True, kw_only=True)
class Leap:
    """An effect far from where the twin is, with the base as it is."""

    name: str
    residuals: list[np.ndarray]
    """Per episode [B, Q, 3] metres."""


def leap_off(
    observations: Sequence[Observation],
    model: ObjectModel,
    effects: Sequence[Ranked],
    *,
    progress: Callable[[float], None],
) -> list[Leap]:
    """Simulate the effects at the leaps from their best starts.

    Args:
        model: without the effects.
        progress: called with the share done.
    """
    pairs = [
        (each.name, there)
        for each in effects
        for start in each.starts[:LEAPT]
        for there in leapt(model, each.probe.effect, start)
    ]
    found = residuals(observations, [there for _, there in pairs], progress=progress)
    return [Leap(name=name, residuals=[each[row] for each in found]) for row, (name, _) in enumerate(pairs)]


def leap_gains(problem: LinearProblem, leaps: Sequence[Leap]) -> dict[str, float]:
    """Per effect what its best leap gains on stretches of time left out, to the others of which the base is turned.

    Args:
        problem: the linear problem where the leaps begin.
    """
    base = base_columns(problem)
    known = left_out_losses(problem, base, problem.fold).sum()
    gains: dict[str, float] = {}
    for leap in leaps:
        # A rollout that diverged gains nothing.
        if all(np.isfinite(each[seen]).all() for each, seen in zip(leap.residuals, problem.cells, strict=True)):
            there = replace(problem, residual=problem.column(leap.residuals))
            gain = float(known - left_out_losses(there, base, problem.fold).sum())
            gains[leap.name] = max(gain, gains.get(leap.name, 0.0))
    return gains
