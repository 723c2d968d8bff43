"""Surrogates: what an effect changes, shifted in time, in any size, gains as much by chance alone."""

from collections.abc import Sequence

import numpy as np

SURROGATES, LEAST_SHIFT_S = 200, 0.5
"""How many, each shifted by so many seconds or more."""


def shifted_p(
    errors: Sequence[np.ndarray],
    changes: Sequence[np.ndarray],
    counts: Sequence[float] | np.ndarray,
    seconds: Sequence[float],
    *,
    floor: float,
    seed: int,
) -> float:
    """Share of surrogates, the effect among them, that gain as much as the effect.

    Args:
        errors: per record [F, ...] metres, without the effect.
        changes: per record [F, ...] metres: what the effect takes off them.
        counts: per record, how many independent values it holds.
        seconds: per record, how long it lasts.
        floor: metres that are left anyway.
        seed: of the shifts.
    """
    random = np.random.default_rng(seed)
    gained = np.zeros(1 + SURROGATES)
    for error, change, count, lasting in zip(errors, changes, counts, seconds, strict=True):
        least = max(1, round(LEAST_SHIFT_S * len(error) / lasting))
        for row, shift in enumerate([0, *random.integers(least, max(least + 1, len(error) - least), SURROGATES)]):
            surrogate = np.roll(change, shift, axis=0)
            share = np.sum(surrogate * error) / max(float(np.sum(surrogate**2)), floor**2)
            had, left = np.mean(error**2), np.mean((error - share * surrogate) ** 2)
            gained[row] += count / 2.0 * np.log((had + floor**2) / (left + floor**2))
    return float(np.mean(gained >= gained[0]))
