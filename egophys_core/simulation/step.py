"""One substep of the simulator, semi-implicit Euler: forces -> velocities -> contact -> positions.

The physics are functions of one node (`advance_velocity`, `advance_position`, `move_controller`). Two kinds of
kernels call them: on a CPU one launch runs all substeps of a frame, on a GPU each substep is two launches with
a thread per node. Terms that act on a node are listed in `advance_velocity`; a new force is a function called
there.
"""

import warp as wp

from egophys_core.simulation.controllers import ControllerArrays, hermite, hermite_velocity
from egophys_core.simulation.ground import collide, project_upward_force
from egophys_core.simulation.lanes import LANES, Lanes
from egophys_core.simulation.springs import SpringArrays, row_force


@wp.struct
class StateArrays:
    """Nodes 0..N-1 of the object, then the controller points N..N+C-1."""

    positions: wp.array3d(dtype=Lanes)
    """[G, N + C, 3] metres, world."""
    velocities: wp.array3d(dtype=Lanes)
    """[G, N + C, 3] m/s."""
    next_velocities: wp.array3d(dtype=Lanes)
    """[G, N, 3] m/s, after the forces of the substep and before contact."""
    node_count: int
    controller_count: int


@wp.struct
class ParameterArrays:
    """Numbers per rollout; all [G] but the masses."""

    inverse_masses: wp.array2d(dtype=Lanes)
    """[G, N] 1/kg."""
    gravity: wp.array(dtype=Lanes)
    """m/s^2, downward."""
    drag: wp.array(dtype=Lanes)
    """1/s."""
    strain_limit: wp.array(dtype=Lanes)
    restitution: wp.array(dtype=Lanes)
    friction: wp.array(dtype=Lanes)
    ground_projection: wp.array(dtype=Lanes)
    contact_threshold: wp.array(dtype=Lanes)
    """Metres."""
    contact_height: wp.array(dtype=Lanes)
    """World z of a node's centre that touches the table, metres."""
    substeps: wp.array(dtype=Lanes)
    """Substeps per frame (a whole number)."""
    frame_duration: wp.array(dtype=Lanes)
    """Seconds."""


@wp.func
def substep_duration(group: int, substep: int, parameters: ParameterArrays) -> Lanes:
    """Seconds of this substep; 0 for a rollout that has done all its substeps of the frame."""
    duration = Lanes()
    for lane in range(LANES):
        count = parameters.substeps[group][lane]
        duration[lane] = wp.where(float(substep) < count, parameters.frame_duration[group][lane] / count, 0.0)
    return duration


@wp.func
def advance_velocity(
    group: int, node: int, dt: Lanes, state: StateArrays, springs: SpringArrays, parameters: ParameterArrays
):
    """Sum the forces on a node and write its velocity after `dt` to `next_velocities`."""
    fx, fy, fz = row_force(
        group, node, state.positions, state.velocities, springs, parameters.strain_limit[group]
    )
    inverse_mass = parameters.inverse_masses[group, node]
    drag = parameters.drag[group]
    vx = state.velocities[group, node, 0]
    vy = state.velocities[group, node, 1]
    vz = state.velocities[group, node, 2]
    ax = wp.cw_mul(fx, inverse_mass) - wp.cw_mul(drag, vx)
    ay = wp.cw_mul(fy, inverse_mass) - wp.cw_mul(drag, vy)
    az = wp.cw_mul(fz, inverse_mass) - wp.cw_mul(drag, vz) - parameters.gravity[group]
    height = state.positions[group, node, 2] - parameters.contact_height[group]
    az = project_upward_force(
        az, height, parameters.contact_threshold[group], parameters.ground_projection[group]
    )
    state.next_velocities[group, node, 0] = vx + wp.cw_mul(dt, ax)
    state.next_velocities[group, node, 1] = vy + wp.cw_mul(dt, ay)
    state.next_velocities[group, node, 2] = vz + wp.cw_mul(dt, az)


@wp.func
def advance_position(group: int, node: int, dt: Lanes, state: StateArrays, parameters: ParameterArrays):
    """Apply table contact to a node's new velocity and move it."""
    vx, vy, vz, rise = collide(
        state.positions[group, node, 2] - parameters.contact_height[group],
        state.next_velocities[group, node, 0],
        state.next_velocities[group, node, 1],
        state.next_velocities[group, node, 2],
        dt,
        parameters.restitution[group],
        parameters.friction[group],
    )
    state.velocities[group, node, 0] = vx
    state.velocities[group, node, 1] = vy
    state.velocities[group, node, 2] = vz
    state.positions[group, node, 0] = state.positions[group, node, 0] + wp.cw_mul(dt, vx)
    state.positions[group, node, 1] = state.positions[group, node, 1] + wp.cw_mul(dt, vy)
    state.positions[group, node, 2] = state.positions[group, node, 2] + rise


@wp.func
def move_controller(
    group: int,
    controller: int,
    substep: int,
    state: StateArrays,
    controllers: ControllerArrays,
    parameters: ParameterArrays,
):
    """Put a controller point where its recorded motion is at the end of the substep."""
    node = state.node_count + controller
    duration = parameters.frame_duration[group]
    share = Lanes()
    for lane in range(LANES):
        share[lane] = wp.min(1.0, float(substep + 1) / parameters.substeps[group][lane])
    for axis in range(3):
        p0 = controllers.start_positions[group, controller, axis]
        p1 = controllers.end_positions[group, controller, axis]
        v0 = controllers.start_velocities[group, controller, axis]
        v1 = controllers.end_velocities[group, controller, axis]
        state.positions[group, node, axis] = hermite(p0, p1, v0, v1, share, duration)
        state.velocities[group, node, axis] = hermite_velocity(p0, p1, v0, v1, share, duration)


@wp.kernel(enable_backward=False)
def advance_frame(
    substeps: int,
    state: StateArrays,
    springs: SpringArrays,
    controllers: ControllerArrays,
    parameters: ParameterArrays,
):
    """All substeps of a frame for one lane group; launched with dim = G on a CPU."""
    group = wp.tid()
    for substep in range(substeps):
        dt = substep_duration(group, substep, parameters)
        for node in range(state.node_count):
            advance_velocity(group, node, dt, state, springs, parameters)
        for node in range(state.node_count):
            advance_position(group, node, dt, state, parameters)
        for controller in range(state.controller_count):
            move_controller(group, controller, substep, state, controllers, parameters)


@wp.kernel(enable_backward=False)
def advance_velocities(
    substep: int, state: StateArrays, springs: SpringArrays, parameters: ParameterArrays
):
    """First half of a substep; launched with dim = (G, N) on a GPU."""
    group, node = wp.tid()
    dt = substep_duration(group, substep, parameters)
    advance_velocity(group, node, dt, state, springs, parameters)


@wp.kernel(enable_backward=False)
def advance_positions(
    substep: int,
    state: StateArrays,
    controllers: ControllerArrays,
    parameters: ParameterArrays,
):
    """Second half of a substep; launched with dim = (G, N + C) on a GPU."""
    group, node = wp.tid()
    if node < state.node_count:
        dt = substep_duration(group, substep, parameters)
        advance_position(group, node, dt, state, parameters)
    else:
        move_controller(group, node - state.node_count, substep, state, controllers, parameters)
