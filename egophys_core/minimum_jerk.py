"""The smooth way from rest to rest of hands and arms, without acceleration at its ends.

s = 10 tau^3 - 15 tau^4 + 6 tau^5 (T. Flash and N. Hogan, J. Neurosci. 5 (1985) 1688).
"""

PEAK_SPEED = 1.875
"""Largest ds/dtau, at tau = 1/2."""

PEAK_ACCELERATION = 10.0 / 3.0**0.5
"""Largest d2s/dtau2."""


def minimum_jerk(tau: float) -> float:
    """The share of the way that is done after a share of the time, both from 0 to 1."""
    return tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
