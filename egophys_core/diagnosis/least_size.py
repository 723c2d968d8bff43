"""The least size of an effect that gains enough."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

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


@dataclass(frozen=True, kw_only=True)
class Look:
    """At an effect of some size."""

    share: float
    """Of the way to a bound."""
    needed: float
    """What it has to gain, in log-likelihood."""


def corrected_shares(
    gains: Callable[[Mapping[int, Look]], Mapping[int, float | None]], first: Sequence[Look]
) -> list[float | None]:
    """Shares of the ways to bounds, corrected to where effects gain what is needed; all are looked at together.

    A gain grows as the square of a small size; later as two looks say.

    Args:
        gains: of some of the effects, by their index in `first`, in log-likelihood; None where it cannot be told: then
            the share is taken as it is.
        first: looks to begin with.

    Returns:
        None where an effect does not gain that much at the bound.
    """
    shares: list[float | None] = [each.share for each in first]
    power, earlier = [POWER] * len(first), dict[int, tuple[float, float]]()
    open_looks = dict(enumerate(first))
    for _ in range(LOOKS):
        gained = gains(open_looks) if open_looks else {}
        for index, look in [*open_looks.items()]:
            needed, share, gain = look.needed, look.share, gained[index]
            if gain is None or (share == 1.0 and gain < needed):
                del open_looks[index]
                continue
            found = max(gain, needed / FARTHEST**2)
            if index in earlier:
                before, of_before = earlier[index]
                power[index] = float(np.clip(np.log(found / of_before) / np.log(share / before), *POWERS))
            times = float(np.clip((needed / found) ** (1.0 / power[index]), 1.0 / FARTHEST, FARTHEST))
            there = min(share * times, 1.0)
            earlier[index], shares[index] = (share, found), there
            if 1.0 / ROUGHLY <= times <= ROUGHLY:
                del open_looks[index]
            else:
                open_looks[index] = replace(look, share=there)
    return [None if each is None or each >= 1.0 else each for each in shares]
