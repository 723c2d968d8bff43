"""The linear problem: coefficients come back, outliers do not matter, chance gains nothing that was left out."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.linear_problem import (
    fit,
    fitted_gain,
    free_columns,
    left_out_losses,
    linear_problem,
    resampled_steps,
    surrogate,
    trusted_columns,
)

SCALE = 1e-3
BLOCKS, CELLS = 30, 12


def problem_with(columns: list[np.ndarray], truth: list[float], *, seed: int = 0, outliers: float = 0.0):
    """Residuals of two episodes that minus the truth times the columns explain, with noise."""
    generator = np.random.default_rng(seed)
    found = []
    for each in columns:
        residual = generator.normal(0, SCALE, each.shape[:-1]) - each @ np.array(truth)
        wild = generator.random(residual.shape) < outliers
        found.append(np.where(wild, residual + 0.05, residual))
    return linear_problem(found, [np.zeros((*each.shape[:-1], 0)) for each in columns], SCALE)


def random_columns(count: int = 2, seed: int = 1) -> list[np.ndarray]:
    """For two episodes, without memory: shifted in time they say nothing of what they were."""
    return list(np.random.default_rng(seed).normal(0, 2e-3, (2, BLOCKS, CELLS, 3, count)))


@pytest.mark.parametrize("outliers", [0.0, 0.1])
def test_coefficients_come_back(outliers):
    columns = random_columns()
    problem = problem_with(columns, [1.5, -0.7], outliers=outliers)
    assert fit(problem.residual, free_columns(problem.column(columns)), SCALE) == pytest.approx([1.5, -0.7], abs=0.15)


def test_a_step_stays_within_its_bounds_and_the_others_make_up_for_it():
    columns = random_columns()
    problem = problem_with(columns, [1.5, -0.7])
    free = free_columns(problem.column(columns))
    bounded = replace(free, low=np.zeros(2))
    assert fit(problem.residual, bounded, SCALE) == pytest.approx([1.5, 0.0], abs=0.2)


def test_trusted_steps_stop_at_their_trust_and_free_ones_do_not():
    columns = random_columns(1)
    problem = problem_with(columns, [5.0])
    values = problem.column(columns)
    assert fit(problem.residual, trusted_columns(values, 2.0), SCALE) == pytest.approx([2.0])
    assert fit(problem.residual, trusted_columns(-values, 2.0), SCALE) == pytest.approx([-2.0])
    assert fit(problem.residual, free_columns(values), SCALE) == pytest.approx([5.0], abs=0.15)
    assert np.isinf([free_columns(values).low, free_columns(values).high]).all()


def test_each_column_may_have_a_trust_of_its_own():
    columns = random_columns()
    problem = problem_with(columns, [3.0, -1.0])
    trust = np.array([2.0, np.inf])
    assert fit(problem.residual, trusted_columns(problem.column(columns), trust), SCALE) == pytest.approx(
        [2.0, -1.0], abs=0.2
    )


def test_the_baseline_explains_no_more_than_it_is_trusted_with():
    columns = random_columns(1)
    problem = problem_with(columns, [5.0])
    known = replace(problem, baseline=problem.column(columns))
    assert fitted_gain(known, free_columns(problem.column(columns))) > 20.0


def test_nothing_to_fit_gives_no_steps():
    assert fit(np.zeros(0), free_columns(np.zeros((0, 2))), SCALE) == pytest.approx([0.0, 0.0])
    assert fit(np.ones(5), free_columns(np.zeros((5, 0))), SCALE).shape == (0,)


def test_a_true_column_gains_on_what_was_left_out_and_a_surrogate_does_not():
    columns = random_columns(1)
    problem = problem_with(columns, [2.0])
    nothing = left_out_losses(problem, free_columns(problem.baseline), problem.fold).sum()
    for groups in (problem.fold, problem.episode):
        assert nothing - left_out_losses(problem, free_columns(problem.column(columns)), groups).sum() > 20.0
    other = surrogate(problem, columns, np.array([0.4, 0.6]), np.roll(np.arange(CELLS), 5))
    assert nothing - left_out_losses(problem, free_columns(other), problem.fold).sum() < 5.0


def test_what_the_baseline_explains_is_no_gain():
    columns = random_columns(1)
    problem = problem_with(columns, [2.0])
    known = replace(problem, baseline=problem.column(columns))
    assert fitted_gain(known, free_columns(problem.column(columns))) == pytest.approx(0.0, abs=1e-2)


def test_unseen_cells_count_nothing():
    columns = random_columns(1)
    found = [np.full((BLOCKS, CELLS, 3), np.nan) for _ in columns]
    found[0][:5] = 0.001
    problem = linear_problem(found, columns, SCALE)
    assert len(problem.residual) == 5 * CELLS * 3
    assert set(problem.episode) == {0}


def test_intervals_hold_the_truth():
    columns = random_columns(1)
    inside = 0
    for seed in range(20):
        problem = problem_with(columns, [1.0], seed=seed)
        steps = resampled_steps(replace(problem, baseline=problem.column(columns)), resamples=100, seed=seed)[:, 0]
        low, high = np.quantile(steps, [0.025, 0.975])
        inside += low <= 1.0 <= high
    assert inside >= 15
