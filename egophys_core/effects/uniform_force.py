"""A force per mass that is the same everywhere and always."""

import warp as wp

from egophys_core.lanes import Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays


@wp.func
def add_uniform_force(
    group: int,
    first: int,
    last: int,
    column: int,
    time: Lanes,
    dt: Lanes,
    state: StateArrays,
    parameters: ParameterArrays,
    numbers: wp.array2d(dtype=Lanes),
    forces: wp.array3d(dtype=Lanes),
):
    """Add m a, N; numbers: a, m/s^2."""
    for node in range(first, last):
        mass = parameters.masses[group, node]
        for axis in range(3):
            forces[group, node, axis] += wp.cw_mul(mass, numbers[group, column + axis])
