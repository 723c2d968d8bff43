"""The least size of an effect that gains enough."""

from collections.abc import Callable

import numpy as np

FINEST = 1e-3
"""Of the way from no effect to its bound: no smaller size is looked for."""


def least_share(gain: Callable[[float], float], needed: float, *, narrowings: int) -> float | None:
    """The share of the way to a bound from which an effect gains what is needed; None where it does not even there.

    Args:
        gain: in log-likelihood at a share; it grows with it.
        needed: as much.
        narrowings: bisections in the logarithm of the share.
    """
    if gain(1.0) < needed:
        return None
    low, high = np.log(FINEST), 0.0
    for _ in range(narrowings):
        middle = (low + high) / 2.0
        enough = gain(float(np.exp(middle))) >= needed
        low, high = (low, middle) if enough else (middle, high)
    return float(np.exp(high))
