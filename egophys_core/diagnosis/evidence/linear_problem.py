"""The linear problem at a refitted twin: which columns, what a change of each parameter does, explain the residual.

All of ranking and judging happens here, without simulating again: robust fits of columns to the residual, their score
on blocks of time and on episodes that were left out, and the same for surrogates, columns shifted in time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.evidence.refit import CORRELATED, PRIOR_STEPS

FOLDS = 3
"""Stretches of time of each episode that are left out in turn."""

LEAST_SLOPE = 0.2
"""Share of the weights that the slopes of the score are taken to sum up to at least; guards a division."""

TRUST = 2.0
"""Steps of a parameter over which what it does is taken to be proportional to it. Slopes of a twin that falls over
where the real object lies still promise gains that no refit attains."""

REWEIGHTINGS = 5
"""Steps of iteratively reweighted least squares."""


@dataclass(frozen=True, kw_only=True)
class LinearProblem:
    """Residuals in one vector, and where each comes from."""

    residual: np.ndarray
    """[M] metres."""
    baseline: np.ndarray
    """[M, D] metres per step of each baseline parameter."""
    episode: np.ndarray
    """[M] which episode."""
    fold: np.ndarray
    """[M] which stretch of which episode."""
    block: np.ndarray
    """[M] which block of time of which episode; the unit of resampling."""
    cells: list[np.ndarray]
    """Per episode [B, Q, 3] bool: which components are in `residual`, in that order."""
    scale: float
    """s of the loss, metres."""

    def column(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """[M, ...] from per-episode arrays [B, Q, 3, ...]; what is not finite counts as no change."""
        return np.nan_to_num(
            np.concatenate([each[seen] for each, seen in zip(values, self.cells, strict=True)]), posinf=0.0, neginf=0.0
        )


def linear_problem(found: Sequence[np.ndarray], jacobian: Sequence[np.ndarray], scale: float) -> LinearProblem:
    """From residuals [B, Q, 3] and slopes [B, Q, 3, D] of each episode.

    Args:
        scale: s of the loss, metres.
    """
    cells = [np.isfinite(each) for each in found]
    numbers, folds = [], []
    first = 0
    for seen in cells:
        blocks = np.broadcast_to(np.arange(len(seen))[:, None, None], seen.shape)[seen]
        numbers.append(first + blocks)
        folds.append(blocks * FOLDS // len(seen))
        first += len(seen)
    episode = np.repeat(np.arange(len(cells)), [seen.sum() for seen in cells])
    problem = LinearProblem(
        residual=np.concatenate([each[seen] for each, seen in zip(found, cells, strict=True)]),
        baseline=np.zeros((len(episode), 0)),
        episode=episode,
        fold=np.concatenate(folds) + FOLDS * episode,
        block=np.concatenate(numbers),
        cells=cells,
        scale=scale,
    )
    return replace(problem, baseline=problem.column(jacobian))


def losses(residual: np.ndarray, scale: float) -> np.ndarray:
    """[M] Cauchy's loss, divided by how many neighbouring residuals say the same."""
    return np.log1p((residual / scale) ** 2) / CORRELATED


@dataclass(frozen=True, kw_only=True)
class Columns:
    """What is fitted to the residual."""

    values: np.ndarray
    """[M, D] metres per step."""
    low: np.ndarray
    """[D] least step: an added mass is no less than nothing."""
    high: np.ndarray
    """[D] largest step."""

    def rows(self, chosen: np.ndarray) -> "Columns":
        """Only some rows."""
        return replace(self, values=self.values[chosen])

    def beside(self, others: "Columns") -> "Columns":
        """These columns, then others."""
        return Columns(
            values=np.concatenate([self.values, others.values], axis=1),
            low=np.concatenate([self.low, others.low]),
            high=np.concatenate([self.high, others.high]),
        )


def free_columns(values: np.ndarray) -> Columns:
    """Columns [M, D] whose steps have no bounds."""
    return trusted_columns(values, np.inf)


def trusted_columns(values: np.ndarray, trust: float | np.ndarray) -> Columns:
    """Columns [M, D] whose steps stay within `trust`, one value or [D]: as far as the slopes are to be believed."""
    ends = np.broadcast_to(np.asarray(trust, dtype=np.float64), values.shape[1:])
    return Columns(values=values, low=-ends, high=ends)


def baseline_columns(problem: LinearProblem) -> Columns:
    """The baseline parameters, whose steps stay within `TRUST`."""
    return trusted_columns(problem.baseline, TRUST)


def fit(residual: np.ndarray, columns: Columns, scale: float) -> np.ndarray:
    """[D] steps that make residual + values @ steps least; 0 where they do not help."""
    values = columns.values
    steps = np.zeros(values.shape[1])
    if not len(steps) or not len(residual):
        return steps
    prior = np.eye(len(steps)) / PRIOR_STEPS**2
    best, best_loss = steps, losses(residual, scale).sum()
    for _ in range(REWEIGHTINGS):
        left = residual + values @ steps
        weighted = values * (2.0 / (scale**2 + left**2) / CORRELATED)[:, None]
        steps = _bounded(weighted.T @ values + prior, -weighted.T @ residual, columns)
        loss = losses(residual + values @ steps, scale).sum() + 0.5 * steps @ prior @ steps
        if loss < best_loss:
            best, best_loss = steps, loss
    return best


def _bounded(matrix: np.ndarray, vector: np.ndarray, columns: Columns) -> np.ndarray:
    """The solution of matrix @ steps = vector; steps beyond their bounds stay there and the others are solved again."""
    steps = np.linalg.solve(matrix, vector)
    kept = np.clip(steps, columns.low, columns.high)
    stuck = kept != steps
    if stuck.any() and not stuck.all():
        free = ~stuck
        rest = np.linalg.solve(matrix[np.ix_(free, free)], vector[free] - matrix[np.ix_(free, stuck)] @ kept[stuck])
        kept[free] = np.clip(rest, columns.low[free], columns.high[free])
    return kept


def fitted_gain(problem: LinearProblem, columns: Columns) -> float:
    """Loss that the baseline parameters and further columns together save against the baseline parameters alone."""
    baseline = baseline_columns(problem)
    return float(_fitted_loss(problem, baseline) - _fitted_loss(problem, baseline.beside(columns)))


def _fitted_loss(problem: LinearProblem, columns: Columns) -> float:
    steps = fit(problem.residual, columns, problem.scale)
    return float(losses(problem.residual + columns.values @ steps, problem.scale).sum())


def left_out_losses(problem: LinearProblem, columns: Columns, groups: np.ndarray) -> np.ndarray:
    """[M] loss of each residual when its group was left out of the fit.

    Args:
        groups: [M] integers, `problem.fold` or `problem.episode`.
    """
    found = np.zeros(len(problem.residual))
    for group in np.unique(groups):
        out = groups == group
        steps = fit(problem.residual[~out], columns.rows(~out), problem.scale)
        found[out] = losses(problem.residual[out] + columns.values[out] @ steps, problem.scale)
    return found


def surrogate(
    problem: LinearProblem, slopes: Sequence[np.ndarray], shares: np.ndarray, patches: np.ndarray
) -> np.ndarray:
    """[M, C] a surrogate: slopes [B, Q, 3, C] shifted round in time, and dealt out among the patches anew.

    Shifted in time alone, an effect that hardly changes while the object is held would be its own surrogate.

    Args:
        shares: [E] of each episode by which it is shifted.
        patches: [Q] a permutation.
    """
    shifted = [
        np.roll(np.nan_to_num(each, posinf=0.0, neginf=0.0), round(share * len(each)), axis=0)[:, patches]
        for each, share in zip(slopes, shares, strict=True)
    ]
    return problem.column(shifted)


def resampled_steps(problem: LinearProblem, *, resamples: int, seed: int) -> np.ndarray:
    """[R, D] steps of the baseline columns fitted to resampled blocks of time, whole ones, because neighbours agree."""
    columns = problem.baseline
    generator = np.random.default_rng(seed)
    blocks = np.unique(problem.block)
    # Blocks in pairs: a residual lasts longer than one of them.
    counts = np.zeros((resamples, blocks.max() + 2))
    for row in range(resamples):
        chosen = generator.choice(blocks, size=(len(blocks) + 1) // 2)
        np.add.at(counts[row], chosen, 1.0)
        np.add.at(counts[row], np.minimum(chosen + 1, blocks.max()), 1.0)
    centre = fit(problem.residual, free_columns(columns), problem.scale)
    left = problem.residual + columns @ centre
    prior = np.eye(columns.shape[1]) / PRIOR_STEPS**2
    weights = 2.0 / (problem.scale**2 + left**2) / CORRELATED
    found = np.empty((resamples, columns.shape[1]))
    for row in range(resamples):
        weighted = columns * (weights * counts[row, problem.block])[:, None]
        found[row] = -np.linalg.solve(weighted.T @ columns + prior, weighted.T @ problem.residual)
    # Reweighted steps answer to a resample less than the optimum itself does: an M-estimator moves by its score over
    # the slope of the score, which is less than its weight (Huber, Robust Statistics, 1981, sec. 6.3).
    slopes = weights * (problem.scale**2 - left**2) / (problem.scale**2 + left**2)
    return np.asarray(centre + (found - centre) * weights.sum() / max(slopes.sum(), LEAST_SLOPE * weights.sum()))
