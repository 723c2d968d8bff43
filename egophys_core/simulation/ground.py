"""The table: a horizontal plane with force projection, restitution and Coulomb friction."""

import warp as wp

from egophys_core.simulation.lanes import LANES, Lanes
from egophys_core.simulation.state import ParameterArrays, StateArrays

# Conditions are products of wp.step (1 where the argument is negative) instead of branches, which would keep
# the compiler from working on all lanes at once.

SMALLEST_SPEED = 1.0e-9
"""Sliding slower than this, m/s, is at rest; guards the division by the sliding speed."""


@wp.func
def project_upward_forces(group: int, first: int, last: int, state: StateArrays, parameters: ParameterArrays):
    """Take upward net force from nodes first..last-1 in the contact band (paper, ground-projection equation).

    F' = F - alpha_g max(0, F.n) n for a node whose height above contact is in [0, threshold), n = +z.
    """
    positions = state.positions
    forces = state.forces
    contact_height = parameters.contact_height[group]
    threshold = parameters.contact_threshold[group]
    projection = parameters.ground_projection[group]
    for node in range(first, last):
        height = positions[group, node, 2] - contact_height
        force = forces[group, node, 2]
        left = Lanes()
        for lane in range(LANES):
            inside = (1.0 - wp.step(height[lane])) * wp.step(height[lane] - threshold[lane])
            left[lane] = force[lane] - inside * projection[lane] * wp.max(force[lane], 0.0)
        forces[group, node, 2] = left


@wp.func
def collide(height: Lanes, vx: Lanes, vy: Lanes, vz: Lanes, dt: Lanes, restitution: Lanes, friction: Lanes):
    """Velocity after the table and the way moved up, for a node that would cross it within `dt`.

    The normal speed is reversed and scaled by the restitution e; the tangential velocity loses what Coulomb
    friction takes for that normal impulse, mu (1 + e) |v_z|, at most all of it. The node falls until it
    touches and moves with the new velocity for the rest of the step.

    Returns:
        vx, vy, vz after contact, m/s, and the upward displacement within `dt`, m.
    """
    new_vx = Lanes()
    new_vy = Lanes()
    new_vz = Lanes()
    rise = Lanes()
    for lane in range(LANES):
        free_rise = dt[lane] * vz[lane]
        hits = wp.step(-dt[lane]) * wp.step(height[lane] + free_rise) * wp.step(vz[lane])
        fall = wp.max(-vz[lane], SMALLEST_SPEED)
        fall_time = wp.clamp(height[lane] / fall, 0.0, dt[lane])
        sliding = wp.sqrt(vx[lane] * vx[lane] + vy[lane] * vy[lane])
        lost = friction[lane] * (1.0 + restitution[lane]) * fall
        kept = wp.max(0.0, 1.0 - lost / wp.max(sliding, SMALLEST_SPEED))
        bounce = restitution[lane] * fall
        new_vx[lane] = vx[lane] + hits * (kept * vx[lane] - vx[lane])
        new_vy[lane] = vy[lane] + hits * (kept * vy[lane] - vy[lane])
        new_vz[lane] = vz[lane] + hits * (bounce - vz[lane])
        rise[lane] = free_rise + hits * ((dt[lane] - fall_time) * bounce - fall_time * fall - free_rise)
    return new_vx, new_vy, new_vz, rise
