"""A generic force law: what acceleration, as a sparse sum of terms in the state, would explain the residual.

The weak form of sparse identification of dynamics (Messenger and Bortz, Weak SINDy, 2021): each term acts on the
observed twin in a rollout of its own, so its column is what it does to the residual over a block, no noisy derivative.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.evidence.law_terms import LAW_TERMS
from egophys_core.diagnosis.evidence.linear_problem import (
    Columns,
    LinearProblem,
    baseline_columns,
    fit,
    free_columns,
    left_out_losses,
)
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import TwinEffect, added
from egophys_core.twin import ObjectModel

MOST_TERMS = 3
"""Terms of a law: more would describe this data, not a law."""

LEAST_TERM_GAIN = 3.0
"""Gain on left-out stretches below which no further term is taken."""


@dataclass(frozen=True, kw_only=True)
class Term:
    """One term of the law."""

    formula: str
    unit: str
    """Of its coefficient."""
    step: float
    """Coefficient that is probed."""
    parameter: str
    """Of `LAW_TERMS`, which simulates it."""


TERMS = (
    *(Term(formula=f"{axis}^", unit="m/s^2", step=0.2, parameter=axis) for axis in "xyz"),
    Term(formula="v", unit="1/s", step=0.5, parameter="linear"),
    Term(formula="|v| v", unit="1/m", step=2.0, parameter="quadratic"),
    Term(formula="sliding direction on the table", unit="m/s^2", step=0.5, parameter="sliding"),
    *(
        Term(formula=f"({axis} - {axis}_mean) {axis}^", unit="1/s^2", step=2.0, parameter=f"stretch_{axis}")
        for axis in "xyz"
    ),
)


@dataclass(frozen=True, kw_only=True)
class Law:
    """A sparse law and what it gains."""

    formula: str
    held_out_gain: float


def find_law(
    observations: Sequence[TrackedEpisode], model: ObjectModel, found: Sequence[np.ndarray], problem: LinearProblem
) -> Law:
    """The best law of at most `MOST_TERMS` terms, chosen one after the other by gain on left-out stretches."""
    with added(LAW_TERMS, candidate=False):
        results = residuals(observations, [_with_term(model, term) for term in TERMS])
    columns = np.stack(
        [
            problem.column([(each[row] - without) / term.step for each, without in zip(results, found, strict=True)])
            for row, term in enumerate(TERMS)
        ],
        axis=1,
    )
    baseline_loss = left_out_losses(problem, baseline_columns(problem), problem.fold).sum()
    chosen: list[int] = []
    gain = 0.0
    while len(chosen) < MOST_TERMS:
        gains = {
            index: baseline_loss - _held(problem, columns[:, [*chosen, index]])
            for index in range(len(TERMS))
            if index not in chosen
        }
        best = max(gains, key=lambda index: gains[index])
        if gains[best] < gain + LEAST_TERM_GAIN:
            break
        chosen, gain = [*chosen, best], gains[best]
    if not chosen:
        return Law(formula="", held_out_gain=0.0)
    coefficients = fit(problem.residual, _beside_baseline(problem, columns[:, chosen]), problem.scale)[
        problem.baseline.shape[1] :
    ]
    terms = [f"{value:+.3g} {TERMS[index].formula}" for value, index in zip(coefficients, chosen, strict=True)]
    units = ", ".join(TERMS[index].unit for index in chosen)
    return Law(formula=f"a = {' '.join(terms)} ({units})", held_out_gain=float(gain))


def _held(problem: LinearProblem, columns: np.ndarray) -> float:
    return float(left_out_losses(problem, _beside_baseline(problem, columns), problem.fold).sum())


def _beside_baseline(problem: LinearProblem, columns: np.ndarray) -> Columns:
    return baseline_columns(problem).beside(free_columns(columns))


def _with_term(model: ObjectModel, term: Term) -> ObjectModel:
    """The model with one term of the law, as large as it is probed."""
    values = {each.name: 0.0 for each in LAW_TERMS.parameters} | {term.parameter: term.step}
    return replace(model, effects=(*model.effects, TwinEffect(name=LAW_TERMS.name, values=values)))
