"""Spring and dashpot forces between nodes (paper, force equation and strain-limiting equation)."""

import warp as wp

from egophys_core.simulation.lanes import LANES, Lanes
from egophys_core.simulation.state import StateArrays

SHORTEST_LENGTH = 1.0e-9
"""Metres. Guards the division by the length: below it the elastic force fades to 0 with the length."""

UNLIMITED = 1.0e9
"""Added to the strain limit of springs that never soften."""


@wp.struct
class SpringArrays:
    """Springs seen from each node (compressed rows): every spring stands in the rows of both its nodes."""

    starts: wp.array(dtype=int)
    """[N + 1] first entry of each node's row."""
    neighbours: wp.array(dtype=int)
    """[D] node at the other end."""
    extra_strain: wp.array(dtype=float)
    """[D] added to the strain limit: 0, or `UNLIMITED` for controller springs, which never soften."""
    stiffness: wp.array2d(dtype=Lanes)
    """[G, D] N/m; 0 where a rollout lacks the spring."""
    damping: wp.array2d(dtype=Lanes)
    """[G, D] N s/m; 0 where a rollout lacks the spring."""
    rest_lengths: wp.array2d(dtype=Lanes)
    """[G, D] metres."""


@wp.func
def elastic_coefficient(squared_length: Lanes, stiffness: Lanes, rest_length: Lanes, strain_limit: Lanes) -> Lanes:
    """k eta (l - l0) / l per lane: times the vector to the neighbour it is the elastic force, N/m.

    The paper softens a stretched spring by eta = min(1, strain_limit / strain). With strain = (l - l0) / l0,
    eta (l - l0) = min(l - l0, strain_limit l0): the extension that counts is capped. Compression is untouched.
    """
    coefficient = Lanes()
    for lane in range(LANES):
        length = wp.sqrt(squared_length[lane])
        extension = wp.min(length - rest_length[lane], strain_limit[lane] * rest_length[lane])
        coefficient[lane] = stiffness[lane] * extension / wp.max(length, SHORTEST_LENGTH)
    return coefficient


@wp.func
def add_spring_forces(
    group: int,
    first: int,
    last: int,
    state: StateArrays,
    springs: SpringArrays,
    strain_limits: wp.array(dtype=Lanes),
):
    """Add sum_j k eta (l - l0) d - gamma (v_i - v_j) to the forces on nodes first..last-1, N."""
    positions = state.positions
    velocities = state.velocities
    forces = state.forces
    neighbours = springs.neighbours
    stiffness = springs.stiffness
    damping = springs.damping
    rest_lengths = springs.rest_lengths
    extra_strain = springs.extra_strain
    strain_limit = strain_limits[group]
    for node in range(first, last):
        x = positions[group, node, 0]
        y = positions[group, node, 1]
        z = positions[group, node, 2]
        vx = velocities[group, node, 0]
        vy = velocities[group, node, 1]
        vz = velocities[group, node, 2]
        fx = Lanes()
        fy = Lanes()
        fz = Lanes()
        for entry in range(springs.starts[node], springs.starts[node + 1]):
            other = neighbours[entry]
            dx = positions[group, other, 0] - x
            dy = positions[group, other, 1] - y
            dz = positions[group, other, 2] - z
            squared_length = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
            elastic = elastic_coefficient(
                squared_length,
                stiffness[group, entry],
                rest_lengths[group, entry],
                strain_limit + Lanes(extra_strain[entry]),
            )
            gamma = damping[group, entry]
            fx += wp.cw_mul(elastic, dx) + wp.cw_mul(gamma, velocities[group, other, 0] - vx)
            fy += wp.cw_mul(elastic, dy) + wp.cw_mul(gamma, velocities[group, other, 1] - vy)
            fz += wp.cw_mul(elastic, dz) + wp.cw_mul(gamma, velocities[group, other, 2] - vz)
        forces[group, node, 0] += fx
        forces[group, node, 1] += fy
        forces[group, node, 2] += fz
