"""How much to trust each point of a tracked surface.

The solver knows the deviation of a point given the view before. What it does not know is how far a point has wandered
that nobody has seen for a while: that grows with its displacement since it was last seen. Nor does it know of growth:
what two hands pull on in the air may be larger and farther away, or of its size and nearer.
"""

import numpy as np
from scipy.spatial import cKDTree

HALF_M = 0.0075
"""Metres: deviation of a point with confidence 0.5; one in twenty such points is off by more than twice that."""

GROWTH = 0.02
"""Strain by which two hands stretch what they hold between them. One camera sees it as coming nearer."""

LIFTED_M = 0.02
"""Metres above the table from which on what is held does not lie on it; lying on it tells how far away it is."""

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
        return confidence_of(np.sqrt(sigma**2 + self._wandered))


def confidence_of(sigma: np.ndarray) -> np.ndarray:
    """[N] in 0..1, from standard deviations in metres."""
    return np.asarray(1 / (1 + (sigma / HALF_M) ** 2))


def growth_sigma(heights: np.ndarray, depths: np.ndarray, holding: int) -> np.ndarray:
    """[N] metres: deviation along the line of sight of points that hands may have stretched.

    Args:
        heights: [N] metres above the table; of a solid, of its lowest point.
        depths: [N] metres along the optical axis.
        holding: how many hands hold the object.
    """
    return np.where((holding > 1) & (heights > LIFTED_M), GROWTH * depths, 0.0)
