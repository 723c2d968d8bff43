"""Exponentials of all lanes at once, made of what the compiler turns into vector instructions."""

import warp as wp

from egophys_core.lanes.packing import LANES, Lanes

PARTS = 16.0
"""Of its argument, of which `falling` multiplies the exponentials: 2 to the number of its squarings."""


@wp.func
def falling(rate: Lanes) -> Lanes:
    """exp(-x) for x of at least 0, to 2e-6 of it up to x = 1, 1e-4 up to 6; it goes to 0 for any x beyond."""
    value = Lanes()
    for lane in range(LANES):
        part = rate[lane] / PARTS
        root = 1.0 / (1.0 + part * (1.0 + part * (0.5 + part * (1.0 / 6.0 + part / 24.0))))
        square = root * root
        fourth = square * square
        eighth = fourth * fourth
        value[lane] = eighth * eighth
    return value


@wp.func_grad(falling)
def adj_falling(rate: Lanes, adj_value: Lanes):
    """The slope of exp(-x) is minus its value."""
    wp.adjoint[rate] -= wp.cw_mul(falling(rate), adj_value)


@wp.func
def gone(rate: Lanes) -> Lanes:
    """1 - exp(-x) for x of at least 0: what relaxes in a step of x time constants; 0 for a step of no length.

    To 1e-6 of it up to x = 0.3; beyond it is between 0 and 1 and grows, as it must for a step to be stable.
    """
    value = Lanes()
    for lane in range(LANES):
        x = rate[lane]
        grown = x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x / 24.0)))
        value[lane] = grown / (1.0 + grown)
    return value
