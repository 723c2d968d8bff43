"""The table: a horizontal plane with force projection, restitution and Coulomb friction."""

import warp as wp

from egophys_core.lanes import LANES, Lanes

# Conditions are products of wp.step (1 where the argument is negative) instead of branches, which would keep
# the compiler from working on all lanes at once.

SMALLEST_SPEED = 1.0e-9
"""Sliding slower than this, m/s, is at rest; guards the division by the sliding speed."""


@wp.func
def project_upward_force(height: Lanes, force: Lanes, projection: Lanes, threshold: Lanes) -> Lanes:
    """What is left of an upward net force in the contact band, N (paper, ground-projection equation).

    F' = F - alpha_g max(0, F.n) n for a node whose height above contact is in [0, threshold), n = +z.
    """
    left = Lanes()
    for lane in range(LANES):
        inside = (1.0 - wp.step(height[lane])) * wp.step(height[lane] - threshold[lane])
        left[lane] = force[lane] - inside * projection[lane] * wp.max(force[lane], 0.0)
    return left


@wp.func_grad(project_upward_force)
def adj_project_upward_force(height: Lanes, force: Lanes, projection: Lanes, threshold: Lanes, adj_left: Lanes):
    """Derivatives of `project_upward_force`; written out, as those of `collide`, because they run much faster."""
    by_force = Lanes()
    by_projection = Lanes()
    for lane in range(LANES):
        inside = (1.0 - wp.step(height[lane])) * wp.step(height[lane] - threshold[lane])
        by_force[lane] = adj_left[lane] * (1.0 - inside * projection[lane] * wp.step(-force[lane]))
        by_projection[lane] = -adj_left[lane] * inside * wp.max(force[lane], 0.0)
    wp.adjoint[force] += by_force
    wp.adjoint[projection] += by_projection


@wp.func
def collide(height: Lanes, vx: Lanes, vy: Lanes, vz: Lanes, dt: Lanes, restitution: Lanes, friction: Lanes):
    """Velocity after the table and the displacement upwards, for a node that would cross it within `dt`.

    The normal speed is reversed and scaled by the restitution e; the tangential velocity loses what Coulomb
    friction takes for that normal impulse, mu (1 + e) |v_z|, at most all of it. The node falls until it
    touches and moves with the new velocity for the rest of the step.

    Returns:
        vx, vy, vz after contact, m/s, and the upward displacement within `dt`, m.
    """
    flies = Lanes()
    for lane in range(LANES):
        flies[lane] = 1.0 - wp.step(height[lane] + dt[lane] * vz[lane])
    if wp.min(flies) == 1.0:
        # No rollout's node comes near the table: what follows would leave all as it is.
        return vx, vy, vz, wp.cw_mul(dt, vz)
    new_vx = Lanes()
    new_vy = Lanes()
    new_vz = Lanes()
    rise = Lanes()
    for lane in range(LANES):
        free_rise = dt[lane] * vz[lane]
        hits = wp.step(-dt[lane]) * wp.step(height[lane] + free_rise) * wp.step(vz[lane])
        fall = wp.max(-vz[lane], SMALLEST_SPEED)
        fall_time = wp.clamp(height[lane] / fall, 0.0, dt[lane])
        sliding = wp.sqrt(wp.max(vx[lane] * vx[lane] + vy[lane] * vy[lane], SMALLEST_SPEED * SMALLEST_SPEED))
        lost = friction[lane] * (1.0 + restitution[lane]) * fall
        kept = wp.max(0.0, 1.0 - lost / sliding)
        bounce = restitution[lane] * fall
        new_vx[lane] = vx[lane] + hits * (kept * vx[lane] - vx[lane])
        new_vy[lane] = vy[lane] + hits * (kept * vy[lane] - vy[lane])
        new_vz[lane] = vz[lane] + hits * (bounce - vz[lane])
        rise[lane] = free_rise + hits * ((dt[lane] - fall_time) * bounce - fall_time * fall - free_rise)
    return new_vx, new_vy, new_vz, rise


@wp.func_grad(collide)
def adj_collide(
    height: Lanes,
    vx: Lanes,
    vy: Lanes,
    vz: Lanes,
    dt: Lanes,
    restitution: Lanes,
    friction: Lanes,
    adj_vx: Lanes,
    adj_vy: Lanes,
    adj_vz: Lanes,
    adj_rise: Lanes,
):
    """Derivatives of `collide`, with the time of the substep and whether it hits the table taken as fixed."""
    by_height = Lanes()
    by_vx = Lanes()
    by_vy = Lanes()
    by_vz = Lanes()
    by_restitution = Lanes()
    by_friction = Lanes()
    for lane in range(LANES):
        hits = wp.step(-dt[lane]) * wp.step(height[lane] + dt[lane] * vz[lane]) * wp.step(vz[lane])
        misses = 1.0 - hits
        fall = wp.max(-vz[lane], SMALLEST_SPEED)
        until_touch = height[lane] / fall
        fall_time = wp.clamp(until_touch, 0.0, dt[lane])
        sliding = wp.sqrt(wp.max(vx[lane] * vx[lane] + vy[lane] * vy[lane], SMALLEST_SPEED * SMALLEST_SPEED))
        lost = friction[lane] * (1.0 + restitution[lane]) * fall
        kept = wp.max(0.0, 1.0 - lost / sliding)
        slides = hits * wp.step(lost - sliding)
        of_kept = slides * (adj_vx[lane] * vx[lane] + adj_vy[lane] * vy[lane])
        of_lost = -of_kept / sliding
        of_sliding = of_kept * lost / (sliding * sliding)
        of_bounce = hits * (adj_vz[lane] + adj_rise[lane] * (dt[lane] - fall_time))
        within = wp.step(-until_touch) * wp.step(until_touch - dt[lane])
        of_touch = -hits * within * adj_rise[lane] * (restitution[lane] * fall + fall)
        of_fall = (
            -hits * adj_rise[lane] * fall_time
            + of_lost * friction[lane] * (1.0 + restitution[lane])
            + of_bounce * restitution[lane]
            - of_touch * until_touch / fall
        )
        by_height[lane] = of_touch / fall
        by_vx[lane] = adj_vx[lane] * (misses + hits * kept) + of_sliding * vx[lane] / sliding
        by_vy[lane] = adj_vy[lane] * (misses + hits * kept) + of_sliding * vy[lane] / sliding
        by_vz[lane] = misses * (adj_vz[lane] + adj_rise[lane] * dt[lane]) - of_fall
        by_restitution[lane] = of_lost * friction[lane] * fall + of_bounce * fall
        by_friction[lane] = of_lost * (1.0 + restitution[lane]) * fall
    wp.adjoint[height] += by_height
    wp.adjoint[vx] += by_vx
    wp.adjoint[vy] += by_vy
    wp.adjoint[vz] += by_vz
    wp.adjoint[restitution] += by_restitution
    wp.adjoint[friction] += by_friction
