"""A generic force law: what acceleration, as a sparse sum of terms in the state, would explain the residual.

The weak form of sparse identification of dynamics (Messenger and Bortz, Weak SINDy, 2021): each term acts on the
observed twin in a rollout of its own, so its column is what it does to the residual over a block, no noisy derivative.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from egophys_core.diagnosis.evidence.linear_problem import (
    Columns,
    LinearProblem,
    baseline_columns,
    fit,
    free_columns,
    left_out_losses,
)
from egophys_core.diagnosis.evidence.residuals import TrackedEpisode, residuals_with
from egophys_core.effects.effect import Action, Load, Scene
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
    acceleration: Callable[[Scene], np.ndarray]
    """[N, 3] m/s^2 at a coefficient of 1."""


def _along(axis: int) -> Callable[[Scene], np.ndarray]:
    return lambda scene: np.broadcast_to(np.eye(3)[axis], scene.positions.shape)


def _stretch(axis: int) -> Callable[[Scene], np.ndarray]:
    def field(scene: Scene) -> np.ndarray:
        return np.eye(3)[axis] * (scene.positions - scene.positions.mean(axis=0))[:, axis : axis + 1]

    return field


def _speed(scene: Scene) -> np.ndarray:
    return np.linalg.norm(scene.velocities, axis=1, keepdims=True)


def _sliding(scene: Scene) -> np.ndarray:
    flat = scene.velocities * [1.0, 1.0, 0.0]
    speed = np.linalg.norm(flat, axis=1, keepdims=True)
    return -flat / np.maximum(speed, 0.03) * scene.on_table[:, None]


TERMS = (
    *(Term(formula=f"{name}^", unit="m/s^2", step=0.2, acceleration=_along(axis)) for axis, name in enumerate("xyz")),
    Term(formula="v", unit="1/s", step=0.5, acceleration=lambda scene: scene.velocities),
    Term(formula="|v| v", unit="1/m", step=2.0, acceleration=lambda scene: _speed(scene) * scene.velocities),
    Term(formula="sliding direction on the table", unit="m/s^2", step=0.5, acceleration=_sliding),
    *(
        Term(formula=f"({name} - {name}_mean) {name}^", unit="1/s^2", step=2.0, acceleration=_stretch(axis))
        for axis, name in enumerate("xyz")
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
    actions = [_action(term) for term in TERMS]
    results = residuals_with(observations, model, actions)
    columns = np.stack(
        [
            problem.column([(each[row] - baseline) / term.step for each, baseline in zip(results, found, strict=True)])
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


def _action(term: Term) -> Action:
    def act(scene: Scene, memory: Any) -> tuple[Load, Any]:
        return Load(acceleration=term.step * term.acceleration(scene)), None

    return act
