"""Judging: refit the twin with an effect, and hold it against the same refit without."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.discrepancy.diagnosis import Estimate
from egophys_core.discrepancy.effects import effect_named
from egophys_core.discrepancy.knobs import Knob, effect_knobs, part_way, turned, with_effect
from egophys_core.discrepancy.leaps import leapt
from egophys_core.discrepancy.linear import (
    TRUST,
    LinearProblem,
    fit,
    free_columns,
    left_out_losses,
    linear_problem,
    losses,
    resampled_steps,
    trusted_columns,
)
from egophys_core.discrepancy.ranking import Ranked
from egophys_core.discrepancy.refit import Fitted, refit, refit_further, robust_loss
from egophys_core.discrepancy.residuals import Observation, residuals
from egophys_core.twin import ObjectModel

SHARES = (0.25, 0.5, 1.0, 2.0)
"""Of the way to the linear optimum at which a refit may start; it lies short of or beyond the true one."""

FINALISTS, TRIAL_STEPS = 3, 1
"""Starts that are refitted, and by how many steps, before the best of them is refitted to the end."""

ALIKE = 0.4
"""Share of an effect's size by which episodes may differ however small the errors: a twin is not that exact."""

AGREEMENT = 2.5
"""Standard errors by which episodes may differ and still agree."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """An effect after its joint refit."""

    name: str
    fitted: Fitted
    problem: LinearProblem
    fitted_gain: float
    held_out_gain: float
    block_gains: np.ndarray
    """[blocks of all episodes] held-out gain in each block of time."""
    gain_ci95: tuple[float, float]
    """Of their sum, over resampled blocks."""
    episode_gains: np.ndarray
    """[E] held-out gain in each episode when it was left out as a whole; nan with one episode."""
    parameters: dict[str, Estimate]
    episodes_agree: bool

    @property
    def gain(self) -> float:
        """What counts: on left-out data, but not what the refit did not reach, which is the linear model's alone."""
        return min(self.fitted_gain, self.held_out_gain)

    @property
    def mimics(self) -> tuple[str, ...]:
        """Effects that look like it."""
        return effect_named(self.name).mimics

    @property
    def values(self) -> dict[str, float]:
        """The fitted parameters."""
        return {name: each.value for name, each in self.parameters.items()}


def judge(
    observations: Sequence[Observation],
    before: Fitted,
    without: LinearProblem,
    ranked: Ranked,
    *,
    earlier: ObjectModel | None,
    others: Sequence[ObjectModel],
    iterations: int,
    bootstraps: int,
    seed: int,
) -> Judged:
    """Refit `before` jointly with an effect from its linear optimum, and hold both against left-out data.

    Args:
        without: the linear problem at `before`.
        earlier: where a refit with the effect ended on a coarser scale; where this one starts, if there is one.
        others: twins without the effect at which the joint refit may start as well.
    """
    name = ranked.name
    own = effect_knobs(effect_named(name))
    knobs = (*before.knobs, *own)
    starts = [earlier] if earlier else _starts(observations, before, ranked, others)[:FINALISTS]
    trials = [refit(observations, start, knobs, iterations=TRIAL_STEPS, scale=before.scale) for start in starts]
    best = min(trials, key=lambda each: each.loss)
    fitted = refit_further(observations, best, iterations=iterations)
    problem = linear_problem(fitted.residuals, fitted.jacobian, fitted.scale)
    # What is the object's stays as all data fitted it, with the effect and without: slopes of the base, followed far
    # when a stretch is left out, say more of their own errors than of the effect. How much of the effect there is, is
    # asked of the other data anew; where and when it acts only nearby, as slopes go no farther.
    reach = np.array([TRUST if knob.parameter.null is None else np.inf for knob in own])
    effect = trusted_columns(problem.base[:, len(before.knobs) :], reach)
    known = _by_block(without, losses(without.residual, without.scale))
    by_fold, by_episode = (
        known - _by_block(problem, left_out_losses(problem, effect, groups))
        for groups in (problem.fold, problem.episode)
    )
    count = len(observations)
    resampled = resampled_steps(problem, resamples=bootstraps, seed=seed)
    return Judged(
        name=name,
        fitted=fitted,
        problem=problem,
        fitted_gain=before.loss - fitted.loss,
        held_out_gain=float(by_fold.sum()),
        block_gains=by_fold,
        gain_ci95=interval_of_sum(by_fold, bootstraps, seed),
        episode_gains=np.array(
            [
                by_episode[np.unique(problem.block[problem.episode == index])].sum() if count > 1 else np.nan
                for index in range(count)
            ]
        ),
        parameters=_estimates(fitted, own, resampled),
        episodes_agree=_agree(problem, fitted.model, own, resampled),
    )


def _starts(
    observations: Sequence[Observation], before: Fitted, ranked: Ranked, others: Sequence[ObjectModel]
) -> list[ObjectModel]:
    """The best point of each way to the effect, the best first.

    An object that falls over where the real one lies still is far from anything linear; and what a twin without the
    effect was bent to, to make up for it, may hold the effect back. So the way to the linear optimum is tried with and
    without the base's share, from `others` as well, and beside it the ways to all starts of the effect.
    """
    effect = ranked.probe.effect
    base = np.array([knob.position(before.model) for knob in before.knobs])
    optima = [part_way(effect, ranked.values, share) for share in SHARES]
    ways = [
        [
            with_effect(turned(before.model, before.knobs, moved), effect.name, values)
            for share, values in zip(SHARES, optima, strict=True)
            for moved in (base, base + min(share, 1.0) * ranked.base_steps)
        ],
        *([with_effect(other, effect.name, values) for values in optima] for other in others),
        *(leapt(before.model, effect, start) for start in ranked.starts),
    ]
    way = np.repeat(np.arange(len(ways)), [len(each) for each in ways])
    models = [model for each in ways for model in each]
    found = residuals(observations, models)
    scores = [robust_loss([each[row] for each in found], before.scale) for row in range(len(models))]
    order = np.argsort(scores)
    _, firsts = np.unique(way[order], return_index=True)
    return [models[order[first]] for first in sorted(firsts)]


def _by_block(problem: LinearProblem, values: np.ndarray) -> np.ndarray:
    """[blocks] sums of values [M] over the blocks of time of all episodes."""
    return np.bincount(problem.block, weights=values)


def interval_of_sum(values: np.ndarray, resamples: int, seed: int) -> tuple[float, float]:
    """95 % interval of a sum over blocks, resampled in runs of five (a second)."""
    generator = np.random.default_rng(seed)
    run = min(5, len(values))
    starts = generator.integers(0, len(values), size=(resamples, -(-len(values) // run)))
    rows = (starts[..., None] + np.arange(run)).reshape(resamples, -1)[:, : len(values)] % len(values)
    low, high = np.quantile(values[rows].sum(axis=1), [0.025, 0.975])
    return float(low), float(high)


def _estimates(fitted: Fitted, own: Sequence[Knob], resampled: np.ndarray) -> dict[str, Estimate]:
    """The effect's parameters, with intervals from the steps of all knobs on resampled blocks [R, D], its own last."""
    found = {}
    for column, knob in enumerate(own, start=resampled.shape[1] - len(own)):
        parameter = knob.parameter
        at = knob.position(fitted.model)
        # The optimum is where the refit ended; resamples say how far it would have gone.
        low, high = at + np.quantile(resampled[:, column] - np.median(resampled[:, column]), [0.025, 0.975])
        ends = [
            float(np.exp(end * parameter.step) if parameter.logarithmic else end * parameter.step)
            for end in (low, high)
        ]
        found[parameter.name] = Estimate(
            value=knob.read(fitted.model), unit=parameter.unit, ci95=(min(ends), max(ends))
        )
    return found


def _agree(problem: LinearProblem, model: ObjectModel, own: Sequence[Knob], resampled: np.ndarray) -> bool:
    """Whether each episode alone asks for the same size of the effect, whose knobs are the last columns.

    Where and when an effect acts may show in one motion only.
    """
    episodes = np.unique(problem.episode)
    if len(episodes) < 2:
        return False
    first = resampled.shape[1] - len(own)
    sizes = [first + index for index, knob in enumerate(own) if knob.parameter.null is not None]
    found = [
        knob.position(model) - knob.position_of(knob.parameter.null) for knob in own if knob.parameter.null is not None
    ]
    spread = resampled.std(axis=0)[sizes]
    alone = []
    for episode in episodes:
        rows = problem.episode == episode
        base = trusted_columns(problem.base[rows, :first], TRUST).beside(free_columns(problem.base[rows, first:]))
        alone.append(fit(problem.residual[rows], base, problem.scale)[sizes])
    # An episode has a share of the data, so its own error is larger by the root of their number.
    apart = np.ptp(alone, axis=0)
    alike = (apart <= AGREEMENT * np.sqrt(2 * len(episodes)) * spread + 1e-9).all()
    return bool(alike or np.linalg.norm(apart) <= ALIKE * np.linalg.norm(found))
