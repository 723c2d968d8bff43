"""The largest strain and speed of rollouts at some moment: what the stability of some effects depends on."""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import StateArrays
from egophys_core.simulation.terms.spring_laws import strain_of
from egophys_core.simulation.terms.springs import SpringArrays


@wp.kernel(enable_backward=False)
def find_extremes(
    nodes: int,
    state: StateArrays,
    springs: SpringArrays,
    strains: wp.array(dtype=Lanes),
    speeds: wp.array(dtype=Lanes),
):
    """Largest strain of the springs that a rollout has, and squared speed of its nodes, m^2/s^2; dim = G."""
    group = wp.tid()
    strain = Lanes()
    speed = Lanes()
    for node in range(nodes):
        x = state.positions[group, node, 0]
        y = state.positions[group, node, 1]
        z = state.positions[group, node, 2]
        vx = state.velocities[group, node, 0]
        vy = state.velocities[group, node, 1]
        vz = state.velocities[group, node, 2]
        squared = wp.cw_mul(vx, vx) + wp.cw_mul(vy, vy) + wp.cw_mul(vz, vz)
        for lane in range(LANES):
            speed[lane] = wp.max(speed[lane], squared[lane])
        for spring in range(springs.starts[node], springs.starts[node + 1]):
            other = springs.ends[spring]
            dx = state.positions[group, other, 0] - x
            dy = state.positions[group, other, 1] - y
            dz = state.positions[group, other, 2] - z
            squared_length = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
            here = strain_of(squared_length, springs.rest_lengths[group, spring])
            stiffness = springs.stiffness[group, spring]
            for lane in range(LANES):
                # A rollout without the spring has a stiffness of 0 there.
                strain[lane] = wp.max(strain[lane], here[lane] * wp.step(-stiffness[lane]))
    strains[group] = strain
    speeds[group] = speed
