"""What a motion would show of each effect, by a twin: its own mismatch is what other twins of the object miss there."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.direct.free_fall_effects import fall_limits, measured_by_falls
from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters
from egophys_core.diagnosis.evidence.linear_problem import LinearProblem, fit, free_columns, linear_problem
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.hypotheses.detection_limits import detection_limits
from egophys_core.diagnosis.hypotheses.ranking import evenly_chosen, probe_effects
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.tracked_episode import TrackedEpisode, observe
from egophys_core.effects import LIBRARY
from egophys_core.episode import Episode
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel

REFITTED, REFIT_STEPS = 5, 3
"""Of the better half of the other twins so many, evenly chosen, are refitted by so many steps where that is asked."""

VARIANTS = 12
"""Other twins, evenly chosen of some three dozen, of which the middle one counts where they are not refitted."""

STARTS, STARTS_OF_CHOSEN = 1, 3
"""Of an effect that are looked at, the middle one of which counts; more where twins are refitted."""


def limits_in(
    model: ObjectModel,
    episode: Episode,
    effects: Collection[str],
    *,
    needed_gain: float,
    least_scale: float,
    refitted: bool = False,
) -> tuple[DetectionLimit, ...]:
    """The detection limits of effects in a predicted episode alone.

    Args:
        model: the twin that predicted it.
        effects: names.
        needed_gain: in log-likelihood.
        least_scale: metres, residuals that the twin has at least.
        refitted: whether other twins are refitted to the prediction, as a diagnosis would, and more of them and of the
            effects' starts are looked at: some ten times the time.
    """
    observations = [observe(model, episode)]
    fitted = refit(observations, model, baseline_parameters(model), iterations=0, scale=least_scale)
    problem = linear_problem(fitted.residuals, fitted.jacobian, least_scale)
    problem = _with_residual(problem, _mismatch(problem, model, observations, refitted=refitted))
    probes = probe_effects(
        observations,
        model,
        fitted.residuals,
        without=LIBRARY.keys() - set(effects),
        progress=lambda share: None,
        most_starts=STARTS_OF_CHOSEN if refitted else STARTS,
    )
    by_residuals = detection_limits(problem, probes, needed_gain=needed_gain)
    by_falls = fall_limits(
        measured_by_falls(effects),
        observations,
        lies_flat=kind_of(model).lies_flat,
        needed=Thresholds().measured_gain,
    )
    falls = {(each.effect, each.parameter): each for each in by_falls}
    return tuple(_lower(each, falls.get((each.effect, each.parameter))) for each in by_residuals)


def _lower(one: DetectionLimit, other: DetectionLimit | None) -> DetectionLimit:
    """The limit of a size that is seen from less on."""
    if other is None or other.size is None:
        return one
    return other if one.size is None or other.size < one.size else one


def _mismatch(
    problem: LinearProblem, model: ObjectModel, observations: Sequence[TrackedEpisode], *, refitted: bool
) -> np.ndarray:
    """[M] metres: residuals of a twin that is as good, but made otherwise.

    Graphs and grasps of other sizes, their parameters moved along slopes, are such twins; the middle one counts.
    Two honest discretisations of one cloth differ by as much as most effects move it where it buckles, and hardly where
    it hangs free. Refitted ones come nearer to what a diagnosis leaves: of a drag found from 0.84 1/m on they expected
    1.4, moved along slopes alone 2.8 (docs/notes/experiments.md). Of a cable there is one graph alone: it misses as
    little as can be.
    """
    others = list(chain.from_iterable(kind_of(model).variants(model)))
    if not refitted:
        others = evenly_chosen(others, VARIANTS)
    if not others:
        return np.zeros_like(problem.residual)
    columns = free_columns(problem.baseline)
    left = [
        residual + columns.values @ fit(residual, columns, problem.scale)
        for residual in (problem.column([each]) for each in residuals(observations, others)[0])
    ]
    order = np.argsort([_size(each) for each in left])
    if refitted:
        better = order[: (len(order) + 1) // 2]
        chosen = evenly_chosen(list(better), REFITTED)
        left = [
            problem.column(
                refit(
                    observations,
                    others[row],
                    baseline_parameters(others[row]),
                    iterations=REFIT_STEPS,
                    scale=problem.scale,
                    turns=False,
                ).residuals
            )
            for row in chosen
        ]
        order = np.argsort([_size(each) for each in left])
    return left[int(order[len(order) // 2])]


def _with_residual(problem: LinearProblem, residual: np.ndarray) -> LinearProblem:
    return replace(problem, residual=residual, scale=max(problem.scale, _size(residual)))


def _size(residual: np.ndarray) -> float:
    """Metres, the median of a residual's components [M]."""
    return float(np.median(np.abs(residual)))
