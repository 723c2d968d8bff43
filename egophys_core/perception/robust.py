"""Estimates that a few wrong measurements do not move."""

import numpy as np

NORMAL_MAD = 1.4826
"""Standard deviation of normally distributed numbers over their median absolute deviation."""


def robust_scale(residuals: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Standard deviation of residuals about zero along an axis, as their median size tells it."""
    return np.asarray(NORMAL_MAD * np.median(np.abs(residuals), axis=axis))


def cauchy_weights(squared: np.ndarray, scale: np.ndarray | float) -> np.ndarray:
    """Weights of reweighted least squares for Cauchy's loss, from squared residuals: a half at `scale`."""
    return np.asarray(1.0 / (1.0 + squared / scale**2))
