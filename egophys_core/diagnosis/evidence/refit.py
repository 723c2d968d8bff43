"""Refit: Levenberg-Marquardt on the residuals of observers, with a loss that forgives where a twin is plainly wrong.

A free-hanging towel is followed to a millimetre, one that is pushed over the table is off by centimetres. Cauchy's loss
log(1 + (e/s)^2) lets the former speak; squares would hear only the latter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import FreeParameter, with_values
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.twin import ObjectModel

CORRELATED = 3.0
"""Residuals that say the same: neighbouring patches are not independent."""

LM_DAMPINGS = (0.001, 0.01, 0.1, 1.0, 10.0, 100.0)
"""Levenberg-Marquardt's lambdas, tried side by side: with the long steps one group of lanes, as cheap as one."""

LONG_STEPS, LONGER = 2, 2.0
"""The least damped steps are also tried at twice their length: far from the optimum residuals saturate the loss."""

ACROSS = 0.5
"""Steps by which each parameter alone is tried where no other step helps: slopes mislead where an object buckles."""

SECANT_OF_FREE_ROLLOUTS = 0.1
"""Of a step of a parameter, or the size of an effect, over which slopes of free rollouts are taken: an
oscillation that is a few percent faster is soon out of phase."""

PRIOR_STEPS = 10.0
"""Standard deviation of a parameter's prior about its start, in steps: what the data say nothing of stays there."""

LEAST_GAIN = 0.5
"""Improvement of the loss below which a refit ends."""

FINALISTS, TRIAL_STEPS = 2, 2
"""Starts that are refitted, and by how many steps, before the best of them is refitted to the end."""


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A model at the end of a refit, with what is needed to judge it without simulating again."""

    model: ObjectModel
    residuals: list[np.ndarray]
    """Per episode [B, Q, 3] metres."""
    jacobian: list[np.ndarray]
    """Per episode [B, Q, 3, D]: change of the residuals per step of each parameter."""
    parameters: tuple[FreeParameter, ...]
    scale: float
    """s of the loss, metres."""

    @property
    def loss(self) -> float:
        """Sum of the loss over all cells."""
        return robust_loss(self.residuals, self.scale)


def cell_losses(residual: np.ndarray, scale: float) -> np.ndarray:
    """[..., Q] loss of each cell [..., Q, 3]; 0 where not seen."""
    return np.log1p(np.nan_to_num(residual / scale) ** 2).sum(axis=-1) / CORRELATED


def robust_loss(found: Sequence[np.ndarray], scale: float) -> float:
    """Sum of log(1 + (e/s)^2) over independent residuals: Cauchy's negative log-likelihood up to a constant."""
    return float(sum(cell_losses(each, scale).sum() for each in found))


def losses_of(observations: Sequence[TrackedEpisode], models: Sequence[ObjectModel], scale: float) -> np.ndarray:
    """[K] loss of each model, simulated together."""
    return losses_by_residuals(residuals(observations, models), scale)


def losses_by_residuals(found: Sequence[np.ndarray], scale: float) -> np.ndarray:
    """[K] loss of each model, by the residuals of all, per episode [K, B, Q, 3] metres."""
    return np.array([robust_loss(rows, scale) for rows in zip(*found, strict=True)])


def best_of_each(groups: Sequence[Sequence[ObjectModel]], losses: np.ndarray) -> list[ObjectModel]:
    """The model of least loss of each group, the best first.

    Args:
        losses: [K] of the models of one group after the other.
    """
    models = [model for group in groups for model in group]
    group = np.repeat(np.arange(len(groups)), [len(each) for each in groups])
    order = np.argsort(losses)
    _, firsts = np.unique(group[order], return_index=True)
    return [models[order[first]] for first in sorted(firsts)]


def median_size(found: Sequence[np.ndarray]) -> float:
    """Metres, of a residual's component."""
    return float(np.median(np.concatenate([np.abs(each[np.isfinite(each)]) for each in found])))


def residual_scale(observations: Sequence[TrackedEpisode], found: Sequence[np.ndarray]) -> float:
    """s, metres: the median size of a residual's component, at least what is evidence; that where all diverged."""
    if not any(np.isfinite(each).any() for each in found):
        return observations[0].least_scale
    return max(median_size(found), observations[0].least_scale)


def refit(
    observations: Sequence[TrackedEpisode],
    model: ObjectModel,
    parameters: Sequence[FreeParameter],
    *,
    iterations: int,
    scale: float | None = None,
    turns: bool = True,
) -> Fitted:
    """Adjust parameters until the residuals are least.

    Args:
        scale: s of the loss, metres; by default from the residuals at the start.
        turns: as in `refit_further`.
    """
    parameters = tuple(parameters)
    beside, steps = neighbours(observations, model, parameters)
    results = residuals(observations, [model, *beside])
    found = [each[0] for each in results]
    scale = scale or residual_scale(observations, found)
    start = Fitted(
        model=model,
        residuals=found,
        jacobian=_slopes(found, [each[1:] for each in results], steps),
        parameters=parameters,
        scale=scale,
    )
    return refit_further(observations, start, iterations=iterations, turns=turns)


def refit_further(
    observations: Sequence[TrackedEpisode], fitted: Fitted, *, iterations: int, turns: bool = True
) -> Fitted:
    """Go on from the end of a refit, which is a start like any other: the prior is about it.

    Args:
        turns: whether, where no step along slopes helps, each parameter alone is tried before the refit ends.
    """
    parameters, scale = fitted.parameters, fitted.scale
    start = np.array([parameter.position(fitted.model) for parameter in parameters])

    def points(models: Sequence[ObjectModel], results: Sequence[np.ndarray]) -> list[_Point]:
        found = []
        for row, model in enumerate(models):
            position = np.array([parameter.position(model) for parameter in parameters])
            own = [each[row] for each in results]
            score = _objective(own, scale, position - start)
            found.append(_Point(model=model, position=position, residuals=own, score=score))
        return found

    def tried(steps: Sequence[np.ndarray]) -> list[_Point]:
        models = [with_values(here.model, parameters, here.position + step) for step in steps]
        return points(models, residuals(observations, models))

    (here,) = points([fitted.model], [each[None] for each in fitted.residuals])
    jacobian, nearby = fitted.jacobian, list[_Point]()
    for _ in range(iterations):
        steps = damped_steps(here.residuals, jacobian, scale, here.position - start, LM_DAMPINGS)
        enough = here.score - LEAST_GAIN
        # A neighbour that was simulated for the slopes may be better than what they predict.
        best = min([*tried([*steps, *(LONGER * each for each in steps[:LONG_STEPS])]), *nearby], key=_score)
        if turns and best.score >= enough:
            best = min(tried([sign * ACROSS * each for each in np.eye(len(start)) for sign in (-1.0, 1.0)]), key=_score)
        if best.score >= enough:
            break
        here = best
        beside, apart = neighbours(observations, here.model, parameters)
        results = residuals(observations, beside)
        jacobian, nearby = _slopes(here.residuals, results, apart), points(beside, results)
    return replace(fitted, model=here.model, residuals=here.residuals, jacobian=jacobian)


def refit_from(
    observations: Sequence[TrackedEpisode],
    starts: Sequence[ObjectModel],
    parameters: Sequence[FreeParameter],
    *,
    scale: float,
    iterations: int,
    hopeless: float = np.inf,
    finalists: int = FINALISTS,
) -> Fitted:
    """The refit from the best of the first few starts.

    Args:
        starts: the best first.
        iterations: most steps from start to end.
        hopeless: a loss; where the best of the first steps leave more, the refit ends with them.
        finalists: of so many starts the one that is best after some steps is refitted to the end.
    """
    trials = [
        refit(observations, start, parameters, iterations=TRIAL_STEPS, scale=scale, turns=False)
        for start in starts[:finalists]
    ]
    best = min(trials, key=lambda each: each.loss)
    if best.loss > hopeless:
        return best
    return refit_further(observations, best, iterations=max(0, iterations - TRIAL_STEPS))


@dataclass(frozen=True, kw_only=True)
class _Point:
    """A model that was simulated."""

    model: ObjectModel
    position: np.ndarray
    """[D] of its parameters, in steps."""
    residuals: list[np.ndarray]
    """Per episode [B, Q, 3] metres."""
    score: float
    """What a refit makes least."""


def _score(point: _Point) -> float:
    return point.score


def prior_loss(moved: np.ndarray) -> np.ndarray:
    """[...] of parameters that moved [..., D] steps from their start."""
    return np.asarray(0.5 * np.sum((moved / PRIOR_STEPS) ** 2, axis=-1))


def _objective(found: Sequence[np.ndarray], scale: float, moved: np.ndarray) -> float:
    """The loss and the prior of parameters that moved [D] steps from their start."""
    return robust_loss(found, scale) + float(prior_loss(moved))


def secant_of(observations: Sequence[TrackedEpisode]) -> float:
    """The share of a step of a parameter, or of the size of an effect, over which slopes are taken."""
    return SECANT_OF_FREE_ROLLOUTS if all(each.free for each in observations) else 1.0


def neighbours(
    observations: Sequence[TrackedEpisode], model: ObjectModel, parameters: Sequence[FreeParameter]
) -> tuple[list[ObjectModel], list[float]]:
    """The model with each parameter moved alone, and by how many steps."""
    secant = secant_of(observations)
    found, steps = [], []
    for parameter in parameters:
        at = parameter.position(model)
        # Backwards where the parameter stands at its upper end.
        ahead = parameter.to(model, at + secant)
        there = ahead if abs(parameter.position(ahead) - at) > 0.1 * secant else parameter.to(model, at - secant)
        found.append(there)
        steps.append(parameter.position(there) - at)
    return found, steps


def _slopes(
    found: Sequence[np.ndarray], of_neighbours: Sequence[np.ndarray], steps: Sequence[float]
) -> list[np.ndarray]:
    """Per episode [B, Q, 3, D]: change of the residuals [B, Q, 3] to those of neighbours [D, B, Q, 3], per step."""
    # Where both diverge there is no slope.
    with np.errstate(invalid="ignore"):
        return [
            np.stack([(there - here) / step for there, step in zip(rows, steps, strict=True)], axis=-1)
            if len(steps)
            else np.zeros((*here.shape, 0))
            for here, rows in zip(found, of_neighbours, strict=True)
        ]


def damped_steps(
    found: Sequence[np.ndarray],
    jacobian: Sequence[np.ndarray],
    scale: float,
    moved: np.ndarray,
    dampings: Sequence[float],
) -> list[np.ndarray]:
    """Steps [D] of iteratively reweighted least squares, one for each damping."""
    matrix, vector = normal_equations(found, jacobian, scale)
    prior = np.eye(len(moved)) / PRIOR_STEPS**2
    matrix = matrix + prior
    vector = vector + moved / PRIOR_STEPS**2
    diagonal = np.diag(np.maximum(np.diag(matrix), 1e-6))
    return [-np.linalg.solve(matrix + damping * diagonal, vector) for damping in dampings]


def normal_equations(
    found: Sequence[np.ndarray], jacobian: Sequence[np.ndarray], scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Newton matrix [D, D] and gradient [D] of the loss; cells unseen or diverged count nothing."""
    count = jacobian[0].shape[-1]
    matrix, vector = np.zeros((count, count)), np.zeros(count)
    for residual, slopes in zip(found, jacobian, strict=True):
        seen = np.isfinite(residual) & np.isfinite(slopes).all(axis=-1)
        values, rows = residual[seen], slopes[seen]
        weights = 2.0 / (scale**2 + values**2) / CORRELATED
        matrix += rows.T @ (weights[:, None] * rows)
        vector += rows.T @ (weights * values)
    return matrix, vector
