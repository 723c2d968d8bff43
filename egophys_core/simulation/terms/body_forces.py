"""Forces that act on every node for itself: gravity and drag."""

import warp as wp

from egophys_core.lanes import Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays


@wp.func
def add_body_forces(
    group: int,
    first: int,
    last: int,
    state: StateArrays,
    parameters: ParameterArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Add weight and drag, m (-g z - drag v), to the forces on nodes first..last-1, N."""
    velocities = state.velocities
    masses = parameters.masses
    gravity = parameters.gravity[group]
    drag = parameters.drag[group]
    for node in range(first, last):
        mass = masses[group, node]
        rate = wp.cw_mul(mass, drag)
        forces[group, node, 0] -= wp.cw_mul(rate, velocities[group, node, 0])
        forces[group, node, 1] -= wp.cw_mul(rate, velocities[group, node, 1])
        forces[group, node, 2] -= wp.cw_mul(rate, velocities[group, node, 2]) + wp.cw_mul(mass, gravity)
