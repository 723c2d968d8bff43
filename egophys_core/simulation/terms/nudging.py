"""Nudging: what draws the nodes of an observer towards observations, decided on the host at the start of each frame.

It is held for the frame, which is short against what observations tell; it damps the velocity of the moment.
"""

import warp as wp

from egophys_core.lanes import Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays


@wp.struct
class NudgingArrays:
    """The nudging of a frame."""

    acts: int
    """1 if nodes are nudged, else 0."""
    accelerations: wp.array3d(dtype=Lanes)
    """[G, N, 3] m/s^2."""
    drags: wp.array2d(dtype=Lanes)
    """[G, N] 1/s."""


@wp.func
def add_nudging(
    group: int,
    first: int,
    last: int,
    state: StateArrays,
    parameters: ParameterArrays,
    nudging: NudgingArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Add m (a - d v) to the forces on nodes first..last-1, N."""
    for node in range(first, last):
        mass = parameters.masses[group, node]
        drag = nudging.drags[group, node]
        for axis in range(3):
            change = nudging.accelerations[group, node, axis] - wp.cw_mul(drag, state.velocities[group, node, axis])
            forces[group, node, axis] += wp.cw_mul(mass, change)
