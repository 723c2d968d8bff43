"""Spring and dashpot forces between nodes (paper, force equation and strain-limiting equation)."""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays

SHORTEST_LENGTH = 1.0e-9
"""Metres. Guards the division by the length: below it the elastic force fades to 0 with the length."""

UNLIMITED = 1.0e9
"""Metres. Longest extension of a spring that never softens."""


@wp.struct
class SpringArrays:
    """Springs in rows, one row per node: each spring stands in the row of its first node."""

    starts: wp.array(dtype=int)
    """[N + 1] first spring of each node's row."""
    ends: wp.array(dtype=int)
    """[E] node at the other end; from N on it is a controller point."""
    stiffness: wp.array2d(dtype=Lanes)
    """[G, E] N/m; 0 where a rollout lacks the spring."""
    damping: wp.array2d(dtype=Lanes)
    """[G, E] N s/m; 0 where a rollout lacks the spring."""
    rest_lengths: wp.array2d(dtype=Lanes)
    """[G, E] metres."""
    longest_extensions: wp.array2d(dtype=Lanes)
    """[G, E] metres: force grows up to this extension, or `UNLIMITED`."""


@wp.func
def elastic_coefficient(squared_length: Lanes, stiffness: Lanes, rest_length: Lanes, longest_extension: Lanes) -> Lanes:
    """k eta (l - l0) / l per lane: times the vector to the other end it is the elastic force, N/m.

    The paper softens a stretched spring by eta = min(1, strain_limit / strain). With strain = (l - l0) / l0,
    eta (l - l0) = min(l - l0, strain_limit l0): the extension that counts is capped. Compression is untouched.
    """
    coefficient = Lanes()
    for lane in range(LANES):
        length = wp.sqrt(wp.max(squared_length[lane], SHORTEST_LENGTH * SHORTEST_LENGTH))
        extension = wp.min(length - rest_length[lane], longest_extension[lane])
        coefficient[lane] = stiffness[lane] * extension / length
    return coefficient


@wp.func
def pressed(squared_length: Lanes, rest_length: Lanes) -> Lanes:
    """1 where a spring is shorter than at rest."""
    shorter = Lanes()
    for lane in range(LANES):
        shorter[lane] = wp.step(squared_length[lane] - rest_length[lane] * rest_length[lane])
    return shorter


@wp.func
def add_spring_forces(
    group: int,
    first: int,
    last: int,
    state: StateArrays,
    springs: SpringArrays,
    parameters: ParameterArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Add k eta (l - l0) d - gamma (v_i - v_j) of the springs in the rows of first..last-1 to both their nodes, N.

    A spring that is pressed has the share `compression_ratio` of its stiffness.
    """
    lost = Lanes(1.0) - parameters.compression_ratio[group]
    positions = state.positions
    velocities = state.velocities
    ends = springs.ends
    stiffness = springs.stiffness
    damping = springs.damping
    rest_lengths = springs.rest_lengths
    longest_extensions = springs.longest_extensions
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
        for spring in range(springs.starts[node], springs.starts[node + 1]):
            other = ends[spring]
            dx = positions[group, other, 0] - x
            dy = positions[group, other, 1] - y
            dz = positions[group, other, 2] - z
            squared_length = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
            rest_length = rest_lengths[group, spring]
            kept = Lanes(1.0) - wp.cw_mul(lost, pressed(squared_length, rest_length))
            elastic = elastic_coefficient(
                squared_length,
                wp.cw_mul(kept, stiffness[group, spring]),
                rest_length,
                longest_extensions[group, spring],
            )
            gamma = damping[group, spring]
            gx = wp.cw_mul(elastic, dx) + wp.cw_mul(gamma, velocities[group, other, 0] - vx)
            gy = wp.cw_mul(elastic, dy) + wp.cw_mul(gamma, velocities[group, other, 1] - vy)
            gz = wp.cw_mul(elastic, dz) + wp.cw_mul(gamma, velocities[group, other, 2] - vz)
            fx += gx
            fy += gy
            fz += gz
            forces[group, other, 0] -= gx
            forces[group, other, 1] -= gy
            forces[group, other, 2] -= gz
        forces[group, node, 0] += fx
        forces[group, node, 1] += fy
        forces[group, node, 2] += fz


@wp.func
def add_grip_forces(
    group: int, first: int, last: int, state: StateArrays, grips: SpringArrays, forces: wp.array3d(dtype=Lanes)
):
    """Add the force of controller springs to nodes first..last-1, N: as other springs, but on one end alone."""
    positions = state.positions
    velocities = state.velocities
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
        for grip in range(grips.starts[node], grips.starts[node + 1]):
            controller = grips.ends[grip]
            dx = positions[group, controller, 0] - x
            dy = positions[group, controller, 1] - y
            dz = positions[group, controller, 2] - z
            squared_length = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
            rest_length = grips.rest_lengths[group, grip]
            longest_extension = grips.longest_extensions[group, grip]
            elastic = elastic_coefficient(squared_length, grips.stiffness[group, grip], rest_length, longest_extension)
            gamma = grips.damping[group, grip]
            gx = wp.cw_mul(elastic, dx) + wp.cw_mul(gamma, velocities[group, controller, 0] - vx)
            gy = wp.cw_mul(elastic, dy) + wp.cw_mul(gamma, velocities[group, controller, 1] - vy)
            gz = wp.cw_mul(elastic, dz) + wp.cw_mul(gamma, velocities[group, controller, 2] - vz)
            fx += gx
            fy += gy
            fz += gz
        forces[group, node, 0] += fx
        forces[group, node, 1] += fy
        forces[group, node, 2] += fz
