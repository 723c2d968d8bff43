"""Judging: hold the twin refitted with an effect against the same refit without."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.evidence.fitted_parameters import FreeParameter
from egophys_core.diagnosis.evidence.linear_problem import (
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
from egophys_core.diagnosis.evidence.refit import Fitted, cell_losses, median_size
from egophys_core.diagnosis.evidence.residuals import TrackedEpisode, residuals
from egophys_core.effects import effect_named
from egophys_core.twin import ObjectModel

ALIKE = 0.4
"""Share of an effect's size by which episodes may differ however small the errors: a twin is not that exact."""

WOULD_SHOW = 45.0
"""Loss of the change that an effect of its size makes in an episode, beside nothing else, from which that can speak for
or against it; beside residuals of the usual size a third of it is left. In a slow pull a drag of 14 1/m changes next to
nothing: it gained 1308 in a swing, and was refuted by what could not show it."""

AGREEMENT = 2.5
"""Standard errors by which episodes may differ and still agree."""


@dataclass(frozen=True, kw_only=True)
class RefittedEffect:
    """An effect after its joint refit."""

    name: str
    fitted: Fitted
    problem: LinearProblem
    left_m: float
    """Median size of the residuals that it leaves."""
    fitted_gain: float
    held_out_gain: float
    block_gains: np.ndarray
    """[blocks of all episodes] held-out gain in each block of time."""
    gain_ci95: tuple[float, float]
    """Of their sum, over resampled blocks."""
    episode_gains: np.ndarray
    """[E] held-out gain in each episode when it was left out as a whole; nan with one episode."""
    validation_gains: np.ndarray
    """[R] the effect's share of the gain in each episode that was not fitted and would show it, `validated`."""
    parameters: dict[str, Estimate]
    episodes_agree: bool

    @property
    def gain(self) -> float:
        """What counts: on left-out data, but not what the refit did not attain, which is the linear model's alone."""
        return min(self.fitted_gain, self.held_out_gain)

    @property
    def confounders(self) -> tuple[str, ...]:
        """Effects it is commonly taken for."""
        return effect_named(self.name).traits.confounders

    @property
    def values(self) -> dict[str, float]:
        """The fitted parameters."""
        return {name: each.value for name, each in self.parameters.items()}


def judge(
    name: str, fitted: Fitted, before: Fitted, without: LinearProblem, *, bootstraps: int, seed: int
) -> RefittedEffect:
    """Hold the twin refitted with an effect, and without, against left-out data.

    Args:
        fitted: its last parameters are those of the effect.
        before: without the effect.
        without: the linear problem there.
    """
    own = fitted.parameters[len(before.parameters) :]
    problem = linear_problem(fitted.residuals, fitted.jacobian, fitted.scale)
    # What is the object's stays as all data fitted it, with the effect and without: slopes of the baseline, followed
    # far when a stretch is left out, say more of their own errors than of the effect. How much of the effect there is,
    # is asked of the other data anew; where and when it acts only nearby, as slopes go no farther.
    trust = np.array([TRUST if parameter.definition.null is None else np.inf for parameter in own])
    effect = trusted_columns(problem.baseline[:, len(before.parameters) :], trust)
    known = _by_block(without, losses(without.residual, without.scale))
    by_fold, by_episode = (
        known - _by_block(problem, left_out_losses(problem, effect, groups))
        for groups in (problem.fold, problem.episode)
    )
    count = int(problem.episode.max()) + 1
    resampled = resampled_steps(problem, resamples=bootstraps, seed=seed)
    return RefittedEffect(
        name=name,
        fitted=fitted,
        problem=problem,
        left_m=median_size(fitted.residuals),
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
        validation_gains=np.zeros(0),
        parameters=_estimates(fitted, own, resampled),
        episodes_agree=_agree(problem, fitted.model, own, resampled),
    )


def validated(
    effects: Sequence[RefittedEffect], before: Fitted, validation: Sequence[TrackedEpisode]
) -> list[RefittedEffect]:
    """Effects with what they gain, as fitted, in episodes that took no part in the fit, where these would show them.

    With an effect the baseline is another one, too, and what that is worth elsewhere is not the effect's doing. Of what
    both gain together the effect has its Shapley share: the mean of what it gains on its own baseline and on that
    without it.
    Source: Shapley, A Value for n-Person Games (1953), for two players.

    Args:
        before: the twin without them, refitted as much.
    """
    joint = [each.fitted.model for each in effects]
    bare = [replace(each, effects=each.effects[:-1]) for each in joint]
    added = [replace(before.model, effects=(*before.model.effects, *each.effects[-1:])) for each in joint]
    found = residuals(validation, [before.model, *joint, *bare, *added])
    count = len(effects)
    shows = np.stack(
        [_would_show(each[1 : 1 + count], each[1 + count : 1 + 2 * count], before.scale) for each in found], axis=1
    )
    losses = np.array([cell_losses(each, before.scale).sum(axis=(1, 2)) for each in found]).reshape(len(found), -1)
    known, rest = losses[:, :1], losses[:, 1:].reshape(len(found), 3, -1)
    with_effect, without, elsewhere = (rest[:, kind] for kind in range(3))
    with np.errstate(invalid="ignore"):
        own, other = without - with_effect, known - elsewhere
    # A baseline that diverges, without the effect or with the other's, says nothing of it.
    own, other = np.where(np.isfinite(own), own, other), np.where(np.isfinite(other), other, own)
    share = np.where(np.isfinite(with_effect), np.nan_to_num((own + other) / 2.0, posinf=0.0, neginf=0.0), -np.inf)
    return [
        replace(each, validation_gains=gain[shown]) for each, gain, shown in zip(effects, share.T, shows, strict=True)
    ]


def _would_show(with_effects: np.ndarray, without: np.ndarray, scale: float) -> np.ndarray:
    """[K] whether taking effects away changes residuals [K, B, Q, 3] of their twins clearly.

    Where a twin diverges that is not known: it counts.
    """
    with np.errstate(invalid="ignore"):
        change = np.where(np.isnan(with_effects), 0.0, without - with_effects)
    diverged = ~np.isfinite(change).all(axis=(1, 2, 3))
    return np.asarray(diverged | (cell_losses(change, scale).sum(axis=(1, 2)) >= WOULD_SHOW))


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


def _estimates(fitted: Fitted, own: Sequence[FreeParameter], resampled: np.ndarray) -> dict[str, Estimate]:
    """The effect's parameters, with intervals from the steps of all on resampled blocks [R, D], its own last."""
    found = {}
    for column, parameter in enumerate(own, start=resampled.shape[1] - len(own)):
        definition = parameter.definition
        at = parameter.position(fitted.model)
        # The optimum is where the refit ended; resamples say how far it would have gone.
        low, high = at + np.quantile(resampled[:, column] - np.median(resampled[:, column]), [0.025, 0.975])
        ends = [
            float(np.exp(end * definition.step) if definition.logarithmic else end * definition.step)
            for end in (low, high)
        ]
        found[definition.name] = Estimate(
            value=parameter.read(fitted.model), unit=definition.unit, ci95=(min(ends), max(ends))
        )
    return found


def _agree(problem: LinearProblem, model: ObjectModel, own: Sequence[FreeParameter], resampled: np.ndarray) -> bool:
    """Whether each episode alone asks for the same size of the effect, whose parameters are the last columns.

    Where and when an effect acts may show in one motion only.
    """
    episodes = np.unique(problem.episode)
    if len(episodes) < 2:
        return False
    first = resampled.shape[1] - len(own)
    sizes = [first + index for index, parameter in enumerate(own) if parameter.definition.null is not None]
    found = [
        parameter.position(model) - parameter.position_of(parameter.definition.null)
        for parameter in own
        if parameter.definition.null is not None
    ]
    spread = resampled.std(axis=0)[sizes]
    alone = []
    for episode in episodes:
        rows = problem.episode == episode
        baseline = trusted_columns(problem.baseline[rows, :first], TRUST).beside(
            free_columns(problem.baseline[rows, first:])
        )
        alone.append(fit(problem.residual[rows], baseline, problem.scale)[sizes])
    # An episode has a share of the data, so its own error is larger by the root of their count.
    apart = np.ptp(alone, axis=0)
    alike = (apart <= AGREEMENT * np.sqrt(2 * len(episodes)) * spread + 1e-9).all()
    return bool(alike or np.linalg.norm(apart) <= ALIKE * np.linalg.norm(found))
