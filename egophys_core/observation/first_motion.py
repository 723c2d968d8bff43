"""How markers move when a record begins: a record may be cut from a longer one, amid a motion."""

import numpy as np

WITHIN_S, FEWEST, DEGREE = 0.08, 6, 3
"""Seconds from the first frame on, at least so many frames, and the degree of the polynomials through them. A parabola
is off by 0.1 m/s in an oscillation, which costs a cable's markers 3 mm; through 5 frames a cubic passes noise on."""


def first_motion(places: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places [K, 3] in metres and velocities [K, 3] in m/s at the first of some times [T] in seconds.

    Args:
        places: [T, K, 3] metres, NaN where unseen, but in the first frame all are seen. A point that is seen in few of
            the first frames is taken to move more simply, one that is not seen again to rest.
    """
    count = max(FEWEST, int(np.searchsorted(times, times[0] + WITHIN_S * (1.0 + 1e-6), side="right")))
    early, since = places[:count], times[:count] - times[0]
    first, velocities = early[0].copy(), np.zeros_like(early[0])
    for point in range(places.shape[1]):
        seen = np.isfinite(early[:, point]).all(axis=1)
        degree = min(DEGREE, int(seen.sum()) - 2)
        if degree > 0:
            motion = np.polynomial.polynomial.polyfit(since[seen], early[seen, point], degree)
            first[point], velocities[point] = motion[:2]
    return first, velocities
