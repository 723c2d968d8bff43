"""How much to trust each point of a tracked surface.

The solver knows the deviation of a point given the view before. What it does not know is how far a point has wandered
that nobody has seen for a while: that grows with its displacement since it was last seen.
"""

import numpy as np
from scipy.spatial import cKDTree

HALF_M = 0.005
"""Metres: deviation of a point with confidence 0.5."""

STANDING_M = 0.0002
"""Metres a view: growth of the deviation of a hidden point that stays where it is."""

MOVING_SHARE = 1.0
"""Growth of the deviation of a hidden point, per displacement."""

NEIGHBOURS = 7
"""A point counts as seen if enough of so many nearest points, itself included, are seen."""

ENOUGH = 0.3
"""Share of them."""


class PointConfidence:
    """Confidence of N points from view to view."""

    def __init__(self, rest: np.ndarray) -> None:
        """Start with points [N, 3] at rest, metres, all of them seen."""
        self._around = cKDTree(rest).query(rest, k=min(NEIGHBOURS, len(rest)))[1].reshape(len(rest), -1)
        self._before = rest
        self._wandered = np.zeros(len(rest))

    def next(self, points: np.ndarray, sigma: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """[N] in 0..1 of the next view.

        Args:
            points: [N, 3] metres.
            sigma: [N] metres: deviation given the view before.
            seen: [N] bool: found in this view.
        """
        displacement = np.linalg.norm(points - self._before, axis=1)
        grown = self._wandered + STANDING_M**2 + (MOVING_SHARE * displacement) ** 2
        self._wandered = np.where(seen[self._around].mean(axis=1) > ENOUGH, 0.0, grown)
        self._before = points
        return 1 / (1 + (sigma**2 + self._wandered) / HALF_M**2)
