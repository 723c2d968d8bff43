"""One substep of the simulator: an ordered list of terms, then semi-implicit Euler.

Every term is a function over a range of nodes that adds to the forces. On a CPU one launch runs all substeps of a
frame and gives each term all nodes at once; on a GPU a substep is two launches with a thread per node. Calling the
terms node by node on the CPU was slower by a quarter (docs/notes/simulation.md).
"""

import warp as wp

from egophys_core.simulation.body_forces import add_body_forces
from egophys_core.simulation.controllers import ControllerArrays, move_controllers
from egophys_core.simulation.ground import collide, project_upward_forces
from egophys_core.simulation.lanes import Lanes
from egophys_core.simulation.springs import SpringArrays, add_spring_forces
from egophys_core.simulation.state import ParameterArrays, StateArrays, substep_duration


@wp.func
def add_forces(
    group: int, first: int, last: int, state: StateArrays, springs: SpringArrays, parameters: ParameterArrays
):
    """All terms, in order; the ground projection acts on the sum of those before it."""
    add_spring_forces(group, first, last, state, springs, parameters.strain_limit)
    add_body_forces(group, first, last, state, parameters)
    project_upward_forces(group, first, last, state, parameters)


@wp.func
def advance_nodes(group: int, first: int, last: int, dt: Lanes, state: StateArrays, parameters: ParameterArrays):
    """Semi-implicit Euler for nodes first..last-1: v += dt F / m, table contact, x += dt v; forces become 0."""
    positions = state.positions
    velocities = state.velocities
    forces = state.forces
    masses = parameters.masses
    contact_height = parameters.contact_height[group]
    restitution = parameters.restitution[group]
    friction = parameters.friction[group]
    for node in range(first, last):
        rate = wp.cw_div(dt, masses[group, node])
        vx, vy, vz, rise = collide(
            positions[group, node, 2] - contact_height,
            velocities[group, node, 0] + wp.cw_mul(rate, forces[group, node, 0]),
            velocities[group, node, 1] + wp.cw_mul(rate, forces[group, node, 1]),
            velocities[group, node, 2] + wp.cw_mul(rate, forces[group, node, 2]),
            dt,
            restitution,
            friction,
        )
        velocities[group, node, 0] = vx
        velocities[group, node, 1] = vy
        velocities[group, node, 2] = vz
        positions[group, node, 0] += wp.cw_mul(dt, vx)
        positions[group, node, 1] += wp.cw_mul(dt, vy)
        positions[group, node, 2] += rise
        forces[group, node, 0] = Lanes()
        forces[group, node, 1] = Lanes()
        forces[group, node, 2] = Lanes()


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
        add_forces(group, 0, state.node_count, state, springs, parameters)
        advance_nodes(group, 0, state.node_count, dt, state, parameters)
        move_controllers(group, 0, state.controller_count, substep, state, controllers, parameters)


@wp.kernel(enable_backward=False)
def gather_forces(state: StateArrays, springs: SpringArrays, parameters: ParameterArrays):
    """First half of a substep; launched with dim = (G, N) on a GPU."""
    group, node = wp.tid()
    add_forces(group, node, node + 1, state, springs, parameters)


@wp.kernel(enable_backward=False)
def advance_substep(substep: int, state: StateArrays, controllers: ControllerArrays, parameters: ParameterArrays):
    """Second half of a substep; launched with dim = (G, N + C) on a GPU."""
    group, node = wp.tid()
    if node < state.node_count:
        dt = substep_duration(group, substep, parameters)
        advance_nodes(group, node, node + 1, dt, state, parameters)
    else:
        controller = node - state.node_count
        move_controllers(group, controller, controller + 1, substep, state, controllers, parameters)
