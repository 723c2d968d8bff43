"""What searches stand on: the twin refitted without any effect, and what recordings show without one."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from egophys_core.diagnosis.direct.measure import MeasuredEffect, measure
from egophys_core.diagnosis.evidence.baseline_twin import BaselineTwin, baseline_beside, fit_baseline, follows
from egophys_core.diagnosis.evidence.refit import Fitted
from egophys_core.diagnosis.evidence.residuals import acceleration
from egophys_core.diagnosis.null_gains import NullGains
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.problem import DiagnosisProblem, Progress
from egophys_core.diagnosis.thresholds import thresholds_for
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel

BASELINE_REFITS = 2
"""Times as many steps for the twin without any effect: what it still gains later on would be taken for an effect's."""


@dataclass(frozen=True, kw_only=True)
class Ground:
    """What is known before any search."""

    problem: DiagnosisProblem
    """With those validation episodes that the twin follows."""
    lost: list[TrackedEpisode]
    """The others."""
    baseline: BaselineTwin
    """With what was measured and shows."""
    bare: Fitted | None
    """Without that, if anything shows."""
    measured: list[MeasuredEffect]


def prepare_ground(
    model: ObjectModel,
    fitted: Sequence[TrackedEpisode],
    validation: Sequence[TrackedEpisode],
    options: DiagnosisOptions,
    *,
    null: NullGains,
    without: Collection[str],
    seed: int,
    progress: Progress,
) -> Ground:
    """Refit the twin as it is, measure what shows directly, and refit it beside that.

    Args:
        model: of the twin.
        fitted: the episodes that are.
        validation: those that are not.
        options: of the diagnosis.
        null: what the best effect gains in such recordings where nothing is lacking.
        without: names of effects that are left out.
        seed: of surrogates and resamples.
        progress: called with stage and share done.
    """
    noise = float(np.median([each.observed.noise for each in fitted]))
    thresholds = thresholds_for(noise, acceleration(fitted), null)
    plain = replace(model, effects=())
    progress("refit the twin as it is", 0.0)
    baseline = fit_baseline(
        fitted, plain, starts=options.baseline_starts, iterations=BASELINE_REFITS * options.refit_iterations
    )
    progress("measure what shows directly", 0.65)
    measured = measure(
        fitted,
        validation,
        lies_flat=kind_of(plain).lies_flat,
        without=without,
        resamples=options.bootstraps,
        seed=seed,
        thresholds=thresholds,
    )
    bare = None
    if shown := {each.name: each.values for each in measured if each.shows}:
        progress("refit the twin beside what was measured", 0.65)
        baseline, bare = baseline_beside(fitted, baseline, shown, iterations=options.refit_iterations)
    followed = follows(baseline.fitted, validation)
    problem = DiagnosisProblem(
        observations=fitted,
        validation=list(compress(validation, followed)),
        options=options,
        seed=seed,
        thresholds=thresholds,
    )
    lost = [each for each, kept in zip(validation, followed, strict=True) if not kept]
    return Ground(problem=problem, lost=lost, baseline=baseline, bare=bare, measured=measured)
