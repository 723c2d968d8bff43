"""Large-amplitude probes: what an effect gains far from the twin as it is.

A twin that lacks an effect has bent to make up for it. Slopes there tell the effect's direction, but far too small a
size, or none; with the effect at several times the size, and the baseline moved back along its own slopes, it may
explain much (docs/notes/discrepancy.md).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import at_null, at_share, with_effect
from egophys_core.diagnosis.evidence.linear_problem import LinearProblem, baseline_columns, left_out_losses
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.hypotheses.ranking import RankedEffect
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import Effect
from egophys_core.twin import ObjectModel

AMPLITUDES = (-3.0, 3.0, 9.0)
"""Times the size at which the search for an effect starts."""

PROBED_STARTS = 2
"""Starts of each effect, the best by their slopes, that are probed so to rank it."""


def at_large_amplitudes(model: ObjectModel, effect: Effect, start: Mapping[str, float]) -> list[ObjectModel]:
    """A model without the effect, with it at each amplitude that does not end at its bound where it vanishes."""
    values = [at_share(effect, start, share) for share in AMPLITUDES]
    return [with_effect(model, effect.name, each) for each in values if each != at_null(effect, each)]


def there_and_beyond(model: ObjectModel, effect: Effect, start: Mapping[str, float]) -> list[ObjectModel]:
    """A model without the effect, with it at a start and at each of the amplitudes from there."""
    return [with_effect(model, effect.name, dict(start)), *at_large_amplitudes(model, effect, start)]


@dataclass(frozen=True, kw_only=True)
class LargeAmplitudeProbe:
    """An effect far from where the twin is, with the baseline as it is."""

    name: str
    residuals: list[np.ndarray]
    """Per episode [B, Q, 3] metres."""


def probe_at_large_amplitude(
    observations: Sequence[TrackedEpisode],
    model: ObjectModel,
    effects: Sequence[RankedEffect],
    *,
    progress: Callable[[float], None],
) -> list[LargeAmplitudeProbe]:
    """Simulate the effects at large amplitudes from their best starts.

    Args:
        model: without the effects.
        progress: called with the share done.
    """
    pairs = [
        (each.name, there)
        for each in effects
        for start in each.starts[:PROBED_STARTS]
        for there in at_large_amplitudes(model, each.probe.effect, start)
    ]
    found = residuals(observations, [there for _, there in pairs], progress=progress)
    return [
        LargeAmplitudeProbe(name=name, residuals=[each[row] for each in found]) for row, (name, _) in enumerate(pairs)
    ]


def large_amplitude_gains(
    problem: LinearProblem, large_amplitude_probes: Sequence[LargeAmplitudeProbe]
) -> dict[str, float]:
    """Per effect what its best probe gains on stretches of time left out, fitting the baseline to the rest.

    Args:
        problem: the linear problem where the probes begin.
    """
    baseline = baseline_columns(problem)
    known = left_out_losses(problem, baseline, problem.fold).sum()
    gains: dict[str, float] = {}
    for probe in large_amplitude_probes:
        # A rollout that diverged gains nothing.
        if all(np.isfinite(each[seen]).all() for each, seen in zip(probe.residuals, problem.cells, strict=True)):
            there = replace(problem, residual=problem.column(probe.residuals))
            gain = float(known - left_out_losses(there, baseline, problem.fold).sum())
            gains[probe.name] = max(gain, gains.get(probe.name, 0.0))
    return gains
