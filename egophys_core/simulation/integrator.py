"""Semi-implicit Euler in two halves: forces change velocities (kick), velocities change positions (drift)."""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import FrameArrays, ParameterArrays, StateArrays
from egophys_core.simulation.terms.carried_air import kick_with_air
from egophys_core.simulation.terms.ground import collide, project_upward_force

FASTEST = 1000.0
"""m/s. A node faster than this, or whose speed is no number, has diverged."""


@wp.func
def kick(
    group: int,
    first: int,
    last: int,
    dt: Lanes,
    state: StateArrays,
    forces: wp.array3d(dtype=Lanes),
    parameters: ParameterArrays,
    kicked: wp.array3d(dtype=Lanes),
):
    """v + dt F / m of nodes first..last-1 into `kicked`, m/s, less what the air keeps; in the contact band F is
    projected first."""
    positions = state.positions
    velocities = state.velocities
    inverse_masses = parameters.inverse_masses
    contact_height = parameters.contact_height[group]
    projection = parameters.ground_projection[group]
    threshold = parameters.contact_threshold[group]
    for node in range(first, last):
        rate = wp.cw_mul(dt, inverse_masses[group, node])
        height = positions[group, node, 2] - contact_height
        upward = project_upward_force(height, forces[group, node, 2], projection, threshold)
        x, y, z = kick_with_air(
            group,
            node,
            wp.cw_mul(rate, forces[group, node, 0]),
            wp.cw_mul(rate, forces[group, node, 1]),
            wp.cw_mul(rate, upward),
            positions,
            parameters,
        )
        kicked[group, node, 0] = velocities[group, node, 0] + x
        kicked[group, node, 1] = velocities[group, node, 1] + y
        kicked[group, node, 2] = velocities[group, node, 2] + z


@wp.func
def drift(
    group: int,
    first: int,
    last: int,
    dt: Lanes,
    positions: wp.array3d(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    parameters: ParameterArrays,
    after: StateArrays,
):
    """Table contact, then x + dt v, of nodes first..last-1 into `after`, which may be the same arrays."""
    contact_height = parameters.contact_height[group]
    restitution = parameters.restitution[group]
    friction = parameters.friction[group]
    for node in range(first, last):
        z = positions[group, node, 2]
        vx, vy, vz, rise = collide(
            z - contact_height,
            velocities[group, node, 0],
            velocities[group, node, 1],
            velocities[group, node, 2],
            dt,
            restitution,
            friction,
        )
        after.velocities[group, node, 0] = vx
        after.velocities[group, node, 1] = vy
        after.velocities[group, node, 2] = vz
        after.positions[group, node, 0] = positions[group, node, 0] + wp.cw_mul(dt, vx)
        after.positions[group, node, 1] = positions[group, node, 1] + wp.cw_mul(dt, vy)
        after.positions[group, node, 2] = z + rise


@wp.func
def clear(group: int, first: int, last: int, values: wp.array3d(dtype=Lanes)):
    """Set the rows first..last-1 of a sum to 0 for the next substep."""
    for node in range(first, last):
        values[group, node, 0] = Lanes()
        values[group, node, 1] = Lanes()
        values[group, node, 2] = Lanes()


@wp.func
def is_calm(vx: Lanes, vy: Lanes, vz: Lanes) -> Lanes:
    """1 where a speed is a number below `FASTEST`, else 0."""
    calm = Lanes()
    for lane in range(LANES):
        # wp.step is 0 for what is no number.
        calm[lane] = wp.step(vx[lane] * vx[lane] + vy[lane] * vy[lane] + vz[lane] * vz[lane] - FASTEST * FASTEST)
    return calm


@wp.func
def find_divergence(
    group: int, first: int, last: int, substep: int, velocities: wp.array3d(dtype=Lanes), frame: FrameArrays
):
    """Record the first substep and node at which a rollout diverges; its substeps take 0 s from then on."""
    calm = Lanes(1.0)
    for node in range(first, last):
        calm = wp.cw_mul(
            calm, is_calm(velocities[group, node, 0], velocities[group, node, 1], velocities[group, node, 2])
        )
    if wp.min(calm) == 0.0:
        for node in range(first, last):
            calm = is_calm(velocities[group, node, 0], velocities[group, node, 1], velocities[group, node, 2])
            for lane in range(LANES):
                if calm[lane] == 0.0:
                    wp.atomic_min(frame.divergence, group, lane, substep * frame.node_count + node)
