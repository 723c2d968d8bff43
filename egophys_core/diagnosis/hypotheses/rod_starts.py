"""Where refits of a cable start: with each effect, on rods of all rigidities.

An oscillation that is out of phase looks as wrong as any other. Without the effect a cable's twin ends where it moves
least, as a bar or in a thick fluid, and from there no slope leads to the effect; with the effect at about its size the
error has a deep and narrow valley over the rigidity, which a scan does not pass over (docs/notes/rods.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.evidence.refit import robust_loss
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.hypotheses.large_amplitude import there_and_beyond
from egophys_core.diagnosis.hypotheses.ranking import RankedEffect
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.kinds.rod import DAMPING_RATIO, retardation_of, rigidity_of, with_bending
from egophys_core.twin import ObjectModel

LENGTHS = np.geomspace(0.03, 0.25, 8)
"""(EI / weight per length)^(1/3) over the length of a rod: cables bend over these; bars need no scan, and much time."""

PLACES = 3
"""Starts of each effect, the best by their slopes, each tried at large amplitudes as well."""

KEPT = 3
"""Starts on rods of each effect that may be refitted."""


@dataclass(frozen=True, kw_only=True)
class RodStart:
    """An effect on the rod on which it leaves least."""

    model: ObjectModel
    residuals: list[np.ndarray]
    """Per episode [B, Q, 3] metres."""

    def loss(self, scale: float) -> float:
        """What it leaves, by residuals of a scale."""
        return robust_loss(self.residuals, scale)


def rod_starts(
    observations: Sequence[TrackedEpisode],
    model: ObjectModel,
    effects: Sequence[RankedEffect],
    scale: float,
    *,
    progress: Callable[[float], None],
) -> dict[str, list[RodStart]]:
    """By effect the best starts on rods, the best first.

    Args:
        model: a rod without the effects.
        scale: of the residuals, metres.
        progress: called with the share done.
    """
    rods, found = _rods(model), dict[str, list[RodStart]]()
    for index, each in enumerate(effects):
        models = [
            there
            for start in each.starts[:PLACES]
            for rod in rods
            for there in there_and_beyond(rod, each.probe.effect, start)
        ]
        results = residuals(observations, models)
        starts = [
            RodStart(model=there, residuals=[episode[row] for episode in results]) for row, there in enumerate(models)
        ]
        found[each.name] = sorted(starts, key=lambda start: start.loss(scale))[:KEPT]
        progress((index + 1) / len(effects))
    return found


def _rods(model: ObjectModel) -> list[ObjectModel]:
    """The rod from limp to stiff, hardly damped and in no fluid."""
    length = float(model.graph.rest_lengths.sum())
    free = replace(model, parameters=replace(model.parameters, drag=0.0))
    rigidities = rigidity_of(LENGTHS * length)
    return [
        with_bending(free, rigidity=each, retardation_time=retardation_of(each, length, DAMPING_RATIO))
        for each in map(float, rigidities)
    ]
