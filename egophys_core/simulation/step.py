"""One substep of the simulator: an ordered list of force terms, then semi-implicit Euler.

Every term is a function over a range of nodes that adds to the forces. On a CPU one launch runs all substeps of a
frame, in place, one thread per lane group; a spring is computed once and added to both its nodes
(docs/notes/simulation.md). `substep` has the same functions as kernels with a thread per node.
"""

from functools import cache

import warp as wp

from egophys_core.simulation.collision.self_collision import (
    PairArrays,
    add_contact_impulses,
    apply_changes,
    count_contacts,
)
from egophys_core.simulation.integrator import clear, drift, find_divergence, kick
from egophys_core.simulation.lanes import Lanes
from egophys_core.simulation.state import FrameArrays, ParameterArrays, StateArrays, substep_duration, substep_time
from egophys_core.simulation.terms.body_forces import add_body_forces
from egophys_core.simulation.terms.controllers import ControllerArrays, move_controllers
from egophys_core.simulation.terms.springs import SpringArrays, add_grip_forces, add_spring_forces

EffectTerms = tuple[tuple[wp.Function, int], ...]
"""Extra terms: the function of each effect and the column of its first number."""


@cache
def node_force_sum(effects: EffectTerms) -> wp.Function:
    """Body forces and effects, in order, as one function over a range of nodes.

    Each effect is added to the sum of those before it, not in a loop over them: Warp tells kernels apart by what they
    refer to, and does not see what a `wp.static` that depends on a loop refers to.
    """
    if not effects:

        @wp.func
        def add_no_effect(
            group: int,
            first: int,
            last: int,
            time: Lanes,
            state: StateArrays,
            parameters: ParameterArrays,
            numbers: wp.array2d(dtype=Lanes),
            forces: wp.array3d(dtype=Lanes),
        ):
            add_body_forces(group, first, last, state, parameters, forces)

        return add_no_effect
    add_before = node_force_sum(effects[:-1])
    add_effect, column = effects[-1]

    @wp.func
    def add_node_forces(
        group: int,
        first: int,
        last: int,
        time: Lanes,
        state: StateArrays,
        parameters: ParameterArrays,
        numbers: wp.array2d(dtype=Lanes),
        forces: wp.array3d(dtype=Lanes),
    ):
        add_before(group, first, last, time, state, parameters, numbers, forces)
        add_effect(group, first, last, wp.static(column), time, state, parameters, numbers, forces)

    return add_node_forces


@cache
def force_sum(effects: EffectTerms) -> wp.Function:
    """All terms, in order, as one function over a range of nodes."""
    add_node_forces = node_force_sum(effects)

    @wp.func
    def add_forces(
        group: int,
        first: int,
        last: int,
        time: Lanes,
        state: StateArrays,
        springs: SpringArrays,
        grips: SpringArrays,
        parameters: ParameterArrays,
        numbers: wp.array2d(dtype=Lanes),
        forces: wp.array3d(dtype=Lanes),
    ):
        add_node_forces(group, first, last, time, state, parameters, numbers, forces)
        # Last, because going back their hand-written adjoints need the derivatives' arrays, which the adjoints that
        # Warp generates for the others replace by empty ones once they are done.
        add_grip_forces(group, first, last, state, grips, forces)
        add_spring_forces(group, first, last, state, springs, parameters, forces)

    return add_forces


@cache
def frame_kernel(effects: EffectTerms) -> wp.Kernel:
    """All substeps of a frame for one lane group, in place; to be launched with dim = G on a CPU."""
    add_forces = force_sum(effects)

    @wp.kernel(enable_backward=False, module="unique")
    def advance_frame(
        state: StateArrays,
        forces: wp.array3d(dtype=Lanes),
        springs: SpringArrays,
        grips: SpringArrays,
        controllers: ControllerArrays,
        parameters: ParameterArrays,
        numbers: wp.array2d(dtype=Lanes),
        pairs: PairArrays,
        contacts: wp.array2d(dtype=Lanes),
        changes: wp.array3d(dtype=Lanes),
        frame: FrameArrays,
    ):
        group = wp.tid()
        nodes = frame.node_count
        # Other groups may need more.
        for substep in range(int(wp.max(frame.substeps[group]))):
            dt = substep_duration(group, substep, frame)
            time = substep_time(group, substep, frame)
            add_forces(group, 0, nodes, time, state, springs, grips, parameters, numbers, forces)
            kick(group, 0, nodes, dt, state, forces, parameters, state.velocities)
            clear(group, 0, nodes, forces)
            if pairs.count > 0:
                count_contacts(group, 0, nodes, state.positions, state.velocities, pairs, contacts)
                add_contact_impulses(
                    group,
                    0,
                    nodes,
                    state.positions,
                    state.velocities,
                    parameters.masses,
                    pairs,
                    contacts,
                    parameters.collision_restitution[group],
                    parameters.collision_friction[group],
                    changes,
                )
                apply_changes(group, 0, nodes, dt, state.velocities, changes, state.velocities)
                clear(group, 0, nodes, changes)
                for node in range(nodes):
                    contacts[group, node] = Lanes()
            drift(group, 0, nodes, dt, state.positions, state.velocities, parameters, state)
            find_divergence(group, 0, nodes, substep, state.velocities, frame)
            move_controllers(group, 0, frame.controller_count, substep, controllers, frame, state)

    return advance_frame
