"""Models that were simulated in some recordings, what they left, and from that how residuals change about each."""

from collections.abc import Sequence

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import with_values
from egophys_core.diagnosis.evidence.refit import Fitted, neighbours, secant_of
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.twin import ObjectModel

MOST_NEAR = 24
"""So many models, the nearest, say how residuals change about one."""

NEAR = 0.5
"""Secants off that a model says most: nearer ones say more of chaos, farther ones of elsewhere."""

RIDGE = 0.1
"""Weight of the slopes that are known at the fitted twin, against moves of about a secant."""


class VisitedModels:
    """All that differ from a fitted twin in the parameters that were fitted; N of D parameters, in M components."""

    def __init__(self, observations: Sequence[TrackedEpisode], fitted: Fitted) -> None:
        """Begin with the fitted twin alone."""
        self._observations, self._fitted = observations, fitted
        self._cells = [
            np.isfinite(found) & np.isfinite(slopes).all(axis=-1)
            for found, slopes in zip(fitted.residuals, fitted.jacobian, strict=True)
        ]
        self._slopes = self._column(fitted.jacobian)
        self._secant = secant_of(observations)
        self._has_neighbours = {0}
        self.positions = self._position(fitted.model)[None]
        """[N, D] steps of each parameter."""
        self.left = self._column(fitted.residuals)[None]
        """[N, M] metres, what each leaves where the twin leaves something finite."""

    def simulated(self, models: Sequence[ObjectModel]) -> np.ndarray:
        """[K, M] metres that any models leave; infinite where one diverged."""
        found = residuals(self._observations, models)
        return np.stack([self._column([each[row] for each in found]) for row in range(len(models))])

    def visit(self, positions: Sequence[np.ndarray]) -> None:
        """Simulate the models at some positions [D], within bounds; those that diverge are not kept."""
        self._keep([with_values(self._fitted.model, self._fitted.parameters, each) for each in positions])

    def visit_neighbours(self, rows: Sequence[int]) -> None:
        """Simulate the models with each parameter of some moved alone."""
        self._has_neighbours.update(rows)
        about = [with_values(self._fitted.model, self._fitted.parameters, self.positions[row]) for row in rows]
        self._keep([to for each in about for to in neighbours(self._observations, each, self._fitted.parameters)[0]])

    def has_neighbours(self, row: int) -> bool:
        """Whether those were simulated."""
        return row in self._has_neighbours

    def slopes(self, row: int) -> np.ndarray:
        """[M, D] metres per step about one model.

        Those at the fitted twin, corrected as little as makes them agree with what the nearest models leave.
        """
        moves = (self.positions - self.positions[row]) / self._secant
        squares = np.sum(moves**2, axis=1)
        near = np.argsort(squares)[: MOST_NEAR + 1]
        near = near[squares[near] > 0.0]
        moves = moves[near]
        weighted = moves / (NEAR**2 + squares[near, None]) ** 2
        missing = self.left[near] - self.left[row] - moves @ self._slopes.T * self._secant
        correction = np.linalg.solve(weighted.T @ moves + RIDGE * np.eye(moves.shape[1]), weighted.T @ missing)
        return np.asarray(self._slopes + correction.T / self._secant)

    def _keep(self, models: Sequence[ObjectModel]) -> None:
        left = self.simulated(models)
        finite = np.isfinite(left).all(axis=1)
        positions = np.stack([self._position(each) for each in models])
        self.positions = np.concatenate([self.positions, positions[finite]])
        self.left = np.concatenate([self.left, left[finite]])

    def _position(self, model: ObjectModel) -> np.ndarray:
        return np.array([parameter.position(model) for parameter in self._fitted.parameters])

    def _column(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """[M, ...] of what the episodes [B, Q, 3, ...] have where the twin leaves something finite."""
        return np.concatenate([each[own] for each, own in zip(values, self._cells, strict=True)])
