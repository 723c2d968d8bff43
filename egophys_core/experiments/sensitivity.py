"""What a motion would show of each effect, by a twin: its own mismatch is what other twins of the object miss there."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters
from egophys_core.diagnosis.evidence.linear_problem import LinearProblem, fit, free_columns, linear_problem
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.evidence.residuals import TrackedEpisode, observe, residuals
from egophys_core.diagnosis.hypotheses.detection_limits import detection_limits
from egophys_core.diagnosis.hypotheses.ranking import probe_effects
from egophys_core.effects import LIBRARY
from egophys_core.episode import Episode
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel


def limits_in(
    model: ObjectModel, episode: Episode, effects: Collection[str], *, needed_gain: float, least_scale: float
) -> tuple[DetectionLimit, ...]:
    """The detection limits of effects in a predicted episode alone.

    Args:
        model: the twin that predicted it.
        effects: names.
        needed_gain: in log-likelihood.
        least_scale: metres, residuals that the twin has at least.
    """
    observations = [observe(model, episode)]
    fitted = refit(observations, model, baseline_parameters(model), iterations=0, scale=least_scale)
    problem = _with_mismatch(linear_problem(fitted.residuals, fitted.jacobian, least_scale), model, observations)
    probes = probe_effects(
        observations,
        model,
        fitted.residuals,
        without=LIBRARY.keys() - set(effects),
        progress=lambda share: None,
    )
    return detection_limits(problem, probes, needed_gain=needed_gain)


def _with_mismatch(problem: LinearProblem, model: ObjectModel, observations: Sequence[TrackedEpisode]) -> LinearProblem:
    """The problem with residuals of a twin that is as good, but made otherwise.

    Graphs and grasps of other sizes, their parameters moved along slopes, are such twins; the middle one counts.
    Two honest discretisations of one cloth differ by as much as most effects move it where it buckles, and hardly where
    it hangs free.
    """
    others = kind_of(model).variants(model)
    found = [problem.column([each]) for each in residuals(observations, others)[0]]
    left = []
    for residual in found:
        columns = free_columns(problem.baseline)
        left.append(residual + columns.values @ fit(residual, columns, problem.scale))
    sizes = [float(np.median(np.abs(each))) for each in left]
    middle = left[int(np.argsort(sizes)[len(sizes) // 2])]
    return replace(problem, residual=middle, scale=max(problem.scale, float(np.median(np.abs(middle)))))
