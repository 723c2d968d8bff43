"""Presses: hands that push whatever comes near them, as balls with Coulomb friction, and never pull."""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays

SHORTEST = 1.0e-9
"""Metres, and m/s. Guards the divisions by a distance from the hand, and by a speed along it."""

SHORTEST_SUBSTEP = 1.0e-9
"""Seconds. A rollout that waits for others takes substeps of 0 s."""


@wp.struct
class PressArrays:
    """The controller points that press in some rollout of a frame."""

    count: int
    """P, how many."""
    controllers: wp.array(dtype=int)
    """[P] index of the controller point."""
    reaches: wp.array2d(dtype=Lanes)
    """[G, P] metres: nodes nearer than this are pushed away; 0 where a rollout's point does not press."""
    stiffness: wp.array(dtype=Lanes)
    """[G] N/m, of the push by depth."""
    damping: wp.array(dtype=Lanes)
    """[G] N s/m, of the push by speed."""


@wp.func
def contact_forces(
    dx: Lanes,
    dy: Lanes,
    dz: Lanes,
    wx: Lanes,
    wy: Lanes,
    wz: Lanes,
    reach: Lanes,
    stiffness: Lanes,
    damping: Lanes,
    friction: Lanes,
    stopping: Lanes,
):
    """Force on a node at d from a pressing point, that moves with w against it, N.

    Within the reach r the push is N = max(0, k (r - |d|) - gamma w.n) along n = d / |d|. Coulomb friction acts against
    the sliding speed s across it with mu N, but with no more than stops the node in this substep: m / dt (`stopping`)
    times s.
    """
    fx = Lanes()
    fy = Lanes()
    fz = Lanes()
    for lane in range(LANES):
        squared = dx[lane] * dx[lane] + dy[lane] * dy[lane] + dz[lane] * dz[lane]
        length = wp.sqrt(wp.max(squared, SHORTEST * SHORTEST))
        nx = dx[lane] / length
        ny = dy[lane] / length
        nz = dz[lane] / length
        depth = reach[lane] - length
        speed = wx[lane] * nx + wy[lane] * ny + wz[lane] * nz
        push = wp.step(-depth) * wp.max(0.0, stiffness[lane] * depth - damping[lane] * speed)
        sx = wx[lane] - speed * nx
        sy = wy[lane] - speed * ny
        sz = wz[lane] - speed * nz
        sliding = wp.sqrt(wp.max(sx * sx + sy * sy + sz * sz, SHORTEST * SHORTEST))
        brake = wp.min(friction[lane] * push / sliding, wp.step(-push) * stopping[lane])
        fx[lane] = push * nx - brake * sx
        fy[lane] = push * ny - brake * sy
        fz[lane] = push * nz - brake * sz
    return fx, fy, fz


@wp.func
def add_press_forces(
    group: int,
    first: int,
    last: int,
    nodes: int,
    dt: Lanes,
    state: StateArrays,
    presses: PressArrays,
    parameters: ParameterArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Add the push and friction of pressing controller points to the forces on nodes first..last-1, N."""
    positions = state.positions
    velocities = state.velocities
    for press in range(presses.count):
        hand = nodes + presses.controllers[press]
        reach = presses.reaches[group, press]
        for node in range(first, last):
            dx = positions[group, node, 0] - positions[group, hand, 0]
            dy = positions[group, node, 1] - positions[group, hand, 1]
            dz = positions[group, node, 2] - positions[group, hand, 2]
            nearer = wp.cw_mul(reach, reach) - wp.cw_mul(dx, dx) - wp.cw_mul(dy, dy) - wp.cw_mul(dz, dz)
            if wp.max(nearer) > 0.0:
                stopping = Lanes()
                mass = parameters.masses[group, node]
                for lane in range(LANES):
                    stopping[lane] = mass[lane] / wp.max(dt[lane], SHORTEST_SUBSTEP)
                fx, fy, fz = contact_forces(
                    dx,
                    dy,
                    dz,
                    velocities[group, node, 0] - velocities[group, hand, 0],
                    velocities[group, node, 1] - velocities[group, hand, 1],
                    velocities[group, node, 2] - velocities[group, hand, 2],
                    reach,
                    presses.stiffness[group],
                    presses.damping[group],
                    parameters.collision_friction[group],
                    stopping,
                )
                forces[group, node, 0] += fx
                forces[group, node, 1] += fy
                forces[group, node, 2] += fz
