"""The least size of an effect that gains enough."""

from collections.abc import Callable

import numpy as np

ROUGHLY = 1.3
"""Times too large or too small: a share that is found so far off is looked at once more."""

FARTHEST = 8.0
"""Times by which one look moves a share at most."""

LOOKS = 3
"""At an effect of some size: each is a refit."""

POWER, POWERS = 2.0, (0.5, 4.0)
"""Of its size as which a gain grows: that of a small effect, and the least and largest that two looks may say."""

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


def corrected_share(gain: Callable[[float], float | None], needed: float, *, first: float) -> float | None:
    """A share of the way to a bound, corrected to where an effect gains what is needed.

    A gain grows as the square of a small size; later as two looks say.

    Args:
        gain: in log-likelihood at a share; None where it cannot be told: then the share is taken as it is.
        needed: as much.
        first: the share to begin with.

    Returns:
        None where it does not gain that much at the bound.
    """
    share, power, least = first, POWER, needed / FARTHEST**2
    earlier: tuple[float, float] | None = None
    for _ in range(LOOKS):
        gained = gain(share)
        if gained is None:
            break
        found = max(gained, least)
        if share == 1.0 and found < needed:
            return None
        if earlier is not None:
            power = float(np.clip(np.log(found / earlier[1]) / np.log(share / earlier[0]), *POWERS))
        times = float(np.clip((needed / found) ** (1.0 / power), 1.0 / FARTHEST, FARTHEST))
        earlier, share = (share, found), min(share * times, 1.0)
        if 1.0 / ROUGHLY <= times <= ROUGHLY:
            break
    return share if share < 1.0 else None
