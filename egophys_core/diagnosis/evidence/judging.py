"""Judging: hold the twin refitted with an effect against the same refit without."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.cores import usable_cores
from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.evidence.fitted_parameters import FreeParameter
from egophys_core.diagnosis.evidence.linear_problem import (
    TRUST,
    LinearProblem,
    baseline_columns,
    fit,
    free_columns,
    left_out_losses,
    linear_problem,
    losses,
    resampled_steps,
    trusted_columns,
)
from egophys_core.diagnosis.evidence.refit import Fitted, cell_losses, median_size, refit
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import effect_named
from egophys_core.twin import ObjectModel

ALIKE = 0.4
"""Share of an effect's size by which episodes may differ however small the errors: a twin is not that exact."""

WOULD_SHOW = 45.0
"""Loss of the change that an effect of its size makes in an episode, beside nothing else and as far as the baseline
does not make up for it, from which that can speak for or against it; beside residuals of the usual size a third of it
is left. In a slow pull a drag of 14 1/m changes next to nothing: it gained 1308 in a swing, and was refuted by what
could not show it."""

VALIDATION_STEPS = 3
"""Steps by which a baseline is refitted to validation episodes, with an effect and without."""

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
    gains_beside_others: np.ndarray | None = None
    """[R] held-out gain beside each other twin of the object, `other_twins`; None where that was not asked."""
    shares_left: np.ndarray | None = None
    """[E] of the track errors of free rollouts without it, what is left with it in each episode that is given, fitted
    or not, `shares_left`; None where that was not looked at."""

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
    by_fold, by_episode = (_gains_by_block(problem, own, without, groups) for groups in (problem.fold, problem.episode))
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


def gain_on_left_out_data(fitted: Fitted, before: Fitted, without: LinearProblem) -> float:
    """As `RefittedEffect.gain` of what `judge` would find.

    Args:
        fitted: its last parameters are those of the effect.
        before: without the effect.
        without: the linear problem there.
    """
    problem = linear_problem(fitted.residuals, fitted.jacobian, fitted.scale)
    by_fold = _gains_by_block(problem, fitted.parameters[len(before.parameters) :], without, problem.fold)
    return min(before.loss - fitted.loss, float(by_fold.sum()))


def validated(
    effects: Sequence[RefittedEffect], before: Fitted, validation: Sequence[TrackedEpisode]
) -> list[RefittedEffect]:
    """Effects with what they gain, as fitted, in episodes that took no part in the fit, where these would show them.

    The baseline is refitted there by a few steps, with the effect and without: what a baseline that other motions bent
    is worth in this one is not the effect's doing. A gravity of 0.6 lost 144 in a pull over the table where the twin
    kept the friction of two lifts, and gains 15 where both have their own.

    Residuals are as large there as the twin without the effect leaves them there: an added mass that was fitted to
    swings, which are followed to 4 mm, was invisible in a pull that is followed to one.

    Args:
        before: the twin without them, refitted as much.
    """
    known = refit(validation, before.model, before.parameters, iterations=VALIDATION_STEPS, turns=False)
    joint = [each.fitted.model for each in effects]
    bare = [replace(each, effects=each.effects[:-1]) for each in joint]
    added = [replace(before.model, effects=(*before.model.effects, *each.effects[-1:])) for each in joint]

    def refitted_there(model: ObjectModel) -> Fitted:
        return refit(validation, model, before.parameters, iterations=VALIDATION_STEPS, scale=known.scale, turns=False)

    with ThreadPoolExecutor(usable_cores()) as pool:
        rest = list(pool.map(refitted_there, [*joint, *bare, *added]))
    count, found = len(effects), []
    for row, each in enumerate(effects):
        with_effect = min(rest[row], rest[2 * count + row], key=lambda fitted: fitted.loss)
        without = min(known, rest[count + row], key=lambda fitted: fitted.loss)
        gains = np.array(
            [_gain(*pair, known.scale) for pair in zip(with_effect.residuals, without.residuals, strict=True)]
        )
        found.append(replace(each, validation_gains=gains[_would_show(with_effect, validation)]))
    return found


def _gain(with_effect: np.ndarray, without: np.ndarray, scale: float) -> float:
    """What residuals [B, Q, 3] lose by an effect; nothing where the twin diverges without it."""
    own, other = (cell_losses(each, scale).sum() for each in (with_effect, without))
    if not np.isfinite(own):
        return -np.inf
    return float(other - own) if np.isfinite(other) else 0.0


def _would_show(fitted: Fitted, episodes: Sequence[TrackedEpisode]) -> np.ndarray:
    """[R] whether taking the last effect away changes residuals of an episode by more than the baseline makes up for.

    Where a twin diverges that is not known: it counts.
    """
    without = [each[0] for each in residuals(episodes, [replace(fitted.model, effects=fitted.model.effects[:-1])])]
    pairs = list(zip(fitted.residuals, without, strict=True))
    diverged = np.array([any(np.isinf(each).any() for each in pair) for pair in pairs])
    problem = linear_problem([other - own for own, other in pairs], fitted.jacobian, fitted.scale)
    columns = baseline_columns(problem)
    left = losses(problem.residual + columns.values @ fit(problem.residual, columns, problem.scale), problem.scale)
    return np.asarray(diverged | (np.bincount(problem.episode, weights=left, minlength=len(episodes)) >= WOULD_SHOW))


def _gains_by_block(
    problem: LinearProblem, own: Sequence[FreeParameter], without: LinearProblem, groups: np.ndarray
) -> np.ndarray:
    """[blocks of all episodes] what an effect gains in each block when its group was left out.

    What is the object's stays as all data fitted it, with the effect and without: slopes of the baseline, followed
    far when a stretch is left out, say more of their own errors than of the effect. How much of the effect there is,
    is asked of the other data anew; where and when it acts only nearby, as slopes go no farther.

    Args:
        problem: with the effect; its last columns are those of its parameters `own`.
        without: the linear problem without it.
        groups: as in `left_out_losses`.
    """
    trust = np.array([TRUST if parameter.definition.null is None else np.inf for parameter in own])
    effect = trusted_columns(problem.baseline[:, problem.baseline.shape[1] - len(own) :], trust)
    known = _by_block(without, losses(without.residual, without.scale))
    return known - _by_block(problem, left_out_losses(problem, effect, groups))


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
        columns = trusted_columns(problem.baseline[rows, :first], TRUST).beside(
            free_columns(problem.baseline[rows, first:])
        )
        alone.append(fit(problem.residual[rows], columns, problem.scale)[sizes])
    # An episode has a share of the data, so its own error is larger by the root of their count.
    apart = np.ptp(alone, axis=0)
    alike = (apart <= AGREEMENT * np.sqrt(2 * len(episodes)) * spread + 1e-9).all()
    return bool(alike or np.linalg.norm(apart) <= ALIKE * np.linalg.norm(found))
