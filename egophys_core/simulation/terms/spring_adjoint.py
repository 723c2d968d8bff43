"""The adjoint of the spring forces, written out: Warp's own takes four times as long on a CPU.

With the force f = c d + gamma w on the first node of a spring and -f on its end, d = x_j - x_i, w = v_j - v_i and
c = k e / l, e = min(l - l0, e_max), and a the derivative of the loss by the force on the first node minus that by
the force on the end::

    dL/dk = a.d e / l,    dL/dgamma = a.w,    dL/dw = gamma a,    dL/dd = c a + a.d (dc/dl) d / l
    uncapped:  dc/dl = k l0 / l^2,     dL/dl0 = -a.d k / l,      dL/de_max = 0
    capped:    dc/dl = -k e_max / l^2, dL/dl0 = 0,               dL/de_max = a.d k / l

A pressed spring has r k in place of k, so dL/dr is the sum of k dL/d(r k) over those, and dL/dk is r dL/d(r k).
"""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays
from egophys_core.simulation.terms.springs import (
    SHORTEST_LENGTH,
    SpringArrays,
    add_grip_forces,
    add_spring_forces,
    pressed,
)


@wp.func
def elastic_adjoint(squared_length: Lanes, work: Lanes, stiffness: Lanes, rest_length: Lanes, longest_extension: Lanes):
    """From a.d: c, (dc/dl) a.d / l, and the derivatives by stiffness, rest length and longest extension."""
    coefficient = Lanes()
    slope = Lanes()
    by_stiffness = Lanes()
    by_rest_length = Lanes()
    by_longest_extension = Lanes()
    for lane in range(LANES):
        inverse = 1.0 / wp.sqrt(wp.max(squared_length[lane], SHORTEST_LENGTH * SHORTEST_LENGTH))
        length = squared_length[lane] * inverse
        extension = wp.min(length - rest_length[lane], longest_extension[lane])
        capped = wp.step(longest_extension[lane] - (length - rest_length[lane]))
        k = stiffness[lane]
        by_length = capped * -longest_extension[lane] + (1.0 - capped) * rest_length[lane]
        coefficient[lane] = k * extension * inverse
        slope[lane] = work[lane] * k * by_length * inverse * inverse * inverse
        by_stiffness[lane] = work[lane] * extension * inverse
        by_rest_length[lane] = (capped - 1.0) * work[lane] * k * inverse
        by_longest_extension[lane] = capped * work[lane] * k * inverse
    return coefficient, slope, by_stiffness, by_rest_length, by_longest_extension


@wp.func
def add_spring_derivatives(
    group: int,
    first: int,
    last: int,
    state: StateArrays,
    springs: SpringArrays,
    compression_ratio: Lanes,
    by_forces: wp.array3d(dtype=Lanes),
    by_positions: wp.array3d(dtype=Lanes),
    by_velocities: wp.array3d(dtype=Lanes),
    by_stiffness: wp.array2d(dtype=Lanes),
    by_damping: wp.array2d(dtype=Lanes),
    by_rest_lengths: wp.array2d(dtype=Lanes),
    by_longest_extensions: wp.array2d(dtype=Lanes),
    grips: bool,
) -> Lanes:
    """Add the derivatives of the loss by all inputs of `add_spring_forces` to those arrays; that by the ratio.

    With `grips` the same for `add_grip_forces`: no force acts on the ends.
    """
    positions = state.positions
    velocities = state.velocities
    lost = Lanes(1.0) - compression_ratio
    by_ratio = Lanes()
    for node in range(first, last):
        x = positions[group, node, 0]
        y = positions[group, node, 1]
        z = positions[group, node, 2]
        vx = velocities[group, node, 0]
        vy = velocities[group, node, 1]
        vz = velocities[group, node, 2]
        px = by_forces[group, node, 0]
        py = by_forces[group, node, 1]
        pz = by_forces[group, node, 2]
        sum_x = Lanes()
        sum_y = Lanes()
        sum_z = Lanes()
        sum_vx = Lanes()
        sum_vy = Lanes()
        sum_vz = Lanes()
        for spring in range(springs.starts[node], springs.starts[node + 1]):
            other = springs.ends[spring]
            dx = positions[group, other, 0] - x
            dy = positions[group, other, 1] - y
            dz = positions[group, other, 2] - z
            ax = px
            ay = py
            az = pz
            if not grips:
                ax -= by_forces[group, other, 0]
                ay -= by_forces[group, other, 1]
                az -= by_forces[group, other, 2]
            wx = velocities[group, other, 0] - vx
            wy = velocities[group, other, 1] - vy
            wz = velocities[group, other, 2] - vz
            squared_length = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
            shorter = pressed(squared_length, springs.rest_lengths[group, spring])
            kept = Lanes(1.0) - wp.cw_mul(lost, shorter)
            coefficient, slope, of_stiffness, of_rest_length, of_longest_extension = elastic_adjoint(
                squared_length,
                wp.cw_mul(ax, dx) + wp.cw_mul(ay, dy) + wp.cw_mul(az, dz),
                wp.cw_mul(kept, springs.stiffness[group, spring]),
                springs.rest_lengths[group, spring],
                springs.longest_extensions[group, spring],
            )
            gamma = springs.damping[group, spring]
            of_damping = wp.cw_mul(ax, wx) + wp.cw_mul(ay, wy) + wp.cw_mul(az, wz)
            by_ratio += wp.cw_mul(shorter, wp.cw_mul(springs.stiffness[group, spring], of_stiffness))
            by_stiffness[group, spring] += wp.cw_mul(kept, of_stiffness)
            by_rest_lengths[group, spring] += of_rest_length
            by_longest_extensions[group, spring] += of_longest_extension
            by_damping[group, spring] += of_damping
            gx = wp.cw_mul(coefficient, ax) + wp.cw_mul(slope, dx)
            gy = wp.cw_mul(coefficient, ay) + wp.cw_mul(slope, dy)
            gz = wp.cw_mul(coefficient, az) + wp.cw_mul(slope, dz)
            ux = wp.cw_mul(gamma, ax)
            uy = wp.cw_mul(gamma, ay)
            uz = wp.cw_mul(gamma, az)
            sum_x += gx
            sum_y += gy
            sum_z += gz
            sum_vx += ux
            sum_vy += uy
            sum_vz += uz
            by_positions[group, other, 0] += gx
            by_positions[group, other, 1] += gy
            by_positions[group, other, 2] += gz
            by_velocities[group, other, 0] += ux
            by_velocities[group, other, 1] += uy
            by_velocities[group, other, 2] += uz
        by_positions[group, node, 0] -= sum_x
        by_positions[group, node, 1] -= sum_y
        by_positions[group, node, 2] -= sum_z
        by_velocities[group, node, 0] -= sum_vx
        by_velocities[group, node, 1] -= sum_vy
        by_velocities[group, node, 2] -= sum_vz
    return by_ratio


@wp.func_grad(add_spring_forces)
def adj_add_spring_forces(
    group: int,
    first: int,
    last: int,
    state: StateArrays,
    springs: SpringArrays,
    parameters: ParameterArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """What the tape calls for `add_spring_forces`."""
    wp.adjoint[parameters.compression_ratio][group] += add_spring_derivatives(
        group,
        first,
        last,
        state,
        springs,
        parameters.compression_ratio[group],
        wp.adjoint[forces],
        wp.adjoint[state.positions],
        wp.adjoint[state.velocities],
        wp.adjoint[springs.stiffness],
        wp.adjoint[springs.damping],
        wp.adjoint[springs.rest_lengths],
        wp.adjoint[springs.longest_extensions],
        False,
    )


@wp.func_replay(add_spring_forces)
def replay_add_spring_forces(
    group: int,
    first: int,
    last: int,
    state: StateArrays,
    springs: SpringArrays,
    parameters: ParameterArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Going back nothing needs the forces again."""


@wp.func_grad(add_grip_forces)
def adj_add_grip_forces(
    group: int, first: int, last: int, state: StateArrays, grips: SpringArrays, forces: wp.array3d(dtype=Lanes)
):
    """What the tape calls for `add_grip_forces`."""
    add_spring_derivatives(
        group,
        first,
        last,
        state,
        grips,
        Lanes(1.0),
        wp.adjoint[forces],
        wp.adjoint[state.positions],
        wp.adjoint[state.velocities],
        wp.adjoint[grips.stiffness],
        wp.adjoint[grips.damping],
        wp.adjoint[grips.rest_lengths],
        wp.adjoint[grips.longest_extensions],
        True,
    )


@wp.func_replay(add_grip_forces)
def replay_add_grip_forces(
    group: int, first: int, last: int, state: StateArrays, grips: SpringArrays, forces: wp.array3d(dtype=Lanes)
):
    """Going back nothing needs the forces again."""
