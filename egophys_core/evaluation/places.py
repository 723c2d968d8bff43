"""Places on a reconstructed point set: which of its points, in which mixture, stand for a given point.

A measured point almost never lies on a reconstructed one. Taking the nearest instead adds up to half a point spacing to
every error (2 to 3 mm at 6 mm), as much as the error to be measured. So a place is the point nearest to the given one
among all weighted means of its reconstructed neighbours; on a surface that leaves the distance from the surface only.
The weights are found once and then follow the neighbours by their ids.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear, nnls
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError

NEIGHBOURS = 8
"""A point inside a square grid has this many around it."""

NEARLY = 1e-8
"""Slope of the squares, in units of the radius, below which a mixture is the nearest."""


@dataclass(frozen=True, kw_only=True)
class Places:
    """Mixtures of points; at most D + 1 of the weights of a place are not 0 in D dimensions."""

    corners: np.ndarray
    """[N, 8] int: points that a place may mix; where there are fewer, any with weight 0."""
    weights: np.ndarray
    """[N, 8] float64, at least 0, with sum 1; all 0 where a place is not identified."""

    @property
    def identified(self) -> np.ndarray:
        """[N] bool."""
        return self.weights.any(axis=1)

    def follow(self, paths: np.ndarray) -> np.ndarray:
        """[T, N, D]: where the places are; NaN if not identified, and while one of the mixed points is NaN.

        Args:
            paths: [T, M, D], the points over time, in the order in which they were identified.
        """
        weights = self.weights[..., None]
        # Not a product alone: an unmixed point that is NaN must not matter, and 0 * NaN is NaN.
        followed = np.where(weights > 0, weights * paths[:, self.corners], 0.0).sum(axis=2)
        followed[:, ~self.identified] = np.nan
        return followed


def identify(points: np.ndarray, wanted: np.ndarray, radius: float) -> Places:
    """For each wanted point the place nearest to it among its at most eight nearest points within the radius.

    Not identified are wanted points that are NaN or have no point within the radius.

    Args:
        points: [M, D] reconstructed, any unit; NaN where there is none.
        wanted: [N, D] in the same unit, at the same time.
        radius: in the same unit; about two spacings of the points.
    """
    if points.ndim != 2 or wanted.ndim != 2 or points.shape[1] != wanted.shape[1]:
        raise EpisodeError(f"points must be [M, D] and wanted [N, D] with one D, got {points.shape} and {wanted.shape}")
    if not 0 < radius < np.inf:
        raise EpisodeError(f"radius must be a positive length in the unit of the points, got {radius}")
    corners = np.zeros((len(wanted), NEIGHBOURS), int)
    weights = np.zeros((len(wanted), NEIGHBOURS))
    usable = np.flatnonzero(np.isfinite(points).all(axis=1))
    asked = np.flatnonzero(np.isfinite(wanted).all(axis=1))
    if len(usable) and len(asked):
        tree = cKDTree(points[usable])
        distances, nearest = tree.query(wanted[asked], k=range(1, NEIGHBOURS + 1), distance_upper_bound=radius)
        for place, near, which in zip(asked, np.isfinite(distances), nearest, strict=True):
            if near.any():
                chosen = usable[which[near]]
                corners[place, near] = chosen
                weights[place, near] = _nearest_mixture((points[chosen] - wanted[place]) / radius)
    return Places(corners=corners, weights=weights)


def _nearest_mixture(offsets: np.ndarray) -> np.ndarray:
    """[K] weights, at least 0, with sum 1, of the weighted mean of [K, D] that is nearest to the origin.

    Least squares for |sum w q|^2 + (sum w - 1)^2, then divided by the sum. For weights s v with sum v = 1 the best s
    leaves d^2 / (1 + d^2), d = |sum v q|, which is least where d is: the soft sum moves s alone.
    """
    system = np.vstack([offsets.T, np.ones(len(offsets))])
    weights = _nonnegative_least_squares(system, np.append(np.zeros(offsets.shape[1]), 1.0))
    return weights / weights.sum()


def _nonnegative_least_squares(system: np.ndarray, target: np.ndarray) -> np.ndarray:
    """[K] the x, at least 0, for which |system x - target| is least, system [D, K].

    SciPy's `nnls` returns other points now and then since 1.15 (scipy issue 25389), so what it says is checked.
    """
    found = nnls(system, target)[0]
    slopes = system.T @ (system @ found - target)
    if (slopes > -NEARLY).all() and (np.abs(slopes[found > 0]) < NEARLY).all():
        return np.asarray(found)
    return np.asarray(lsq_linear(system, target, bounds=(0.0, np.inf), method="bvls").x)
