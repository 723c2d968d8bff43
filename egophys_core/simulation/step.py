"""One substep of the simulator: an ordered list of force terms, then semi-implicit Euler.

Every term is a function over a range of nodes that adds to the forces. On a CPU one launch runs all substeps of a
frame, in place, one thread per lane group; a spring is computed once and added to both its nodes
(docs/notes/simulation.md). `substep` has the same functions as kernels with a thread per node.
"""

from functools import cache

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import FrameArrays, ParameterArrays, StateArrays, substep_duration, substep_time
from egophys_core.simulation.collision.self_collision import (
    PairArrays,
    add_contact_impulses,
    apply_changes,
    count_contacts,
)
from egophys_core.simulation.integrator import clear, drift, find_divergence, kick
from egophys_core.simulation.terms.body_forces import add_body_forces
from egophys_core.simulation.terms.controllers import ControllerArrays, move_controllers
from egophys_core.simulation.terms.effects import NO_LAW, SEVERAL_LAWS, EffectArrays, EffectTerms
from egophys_core.simulation.terms.material_frames import RodArrays
from egophys_core.simulation.terms.nudging import NudgingArrays, add_nudging
from egophys_core.simulation.terms.presses import PressArrays, add_press_forces
from egophys_core.simulation.terms.rod_bending import add_bending_forces
from egophys_core.simulation.terms.spring_laws import lawful_springs
from egophys_core.simulation.terms.springs import SpringArrays, add_grip_forces, add_spring_forces


@cache
def node_force_sum(forces: tuple[tuple[str, wp.Function], ...]) -> wp.Function:
    """Body forces and those of effects, in order, as one function over a range of nodes.

    Each effect is added to the sum of those before it, not in a loop over them: Warp tells kernels apart by what they
    refer to, and does not see what a `wp.static` that depends on a loop refers to.
    """
    if not forces:

        @wp.func
        def add_no_effect(
            group: int,
            first: int,
            last: int,
            time: Lanes,
            dt: Lanes,
            state: StateArrays,
            parameters: ParameterArrays,
            effects: EffectArrays,
            forces: wp.array3d(dtype=Lanes),
        ):
            add_body_forces(group, first, last, state, parameters, forces)

        return add_no_effect
    add_before = node_force_sum(forces[:-1])
    index, add_effect = len(forces) - 1, forces[-1][1]

    @wp.func
    def add_node_forces(
        group: int,
        first: int,
        last: int,
        time: Lanes,
        dt: Lanes,
        state: StateArrays,
        parameters: ParameterArrays,
        effects: EffectArrays,
        forces: wp.array3d(dtype=Lanes),
    ):
        add_before(group, first, last, time, dt, state, parameters, effects, forces)
        column = effects.columns[group, wp.static(index)]
        if column >= 0:
            add_effect(group, first, last, column, time, dt, state, parameters, effects.numbers, forces)

    return add_node_forces


@wp.func
def add_held_forces(
    group: int,
    first: int,
    last: int,
    nodes: int,
    state: StateArrays,
    parameters: ParameterArrays,
    rods: RodArrays,
    nudging: NudgingArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Bending and nudging, part of which is held for a frame: there are no derivatives of rollouts with them."""
    if rods.bend == 1:
        add_bending_forces(group, first, last, nodes, state, rods, forces)
    if nudging.acts == 1:
        add_nudging(group, first, last, state, parameters, nudging, forces)


@cache
def force_sum(terms: EffectTerms | None) -> wp.Function:
    """All other terms, in order, over a range of nodes, but the springs of a lane group with a spring law."""
    add_node_forces = node_force_sum(terms.forces if terms else ())
    has_laws = terms is not None and bool(terms.laws)

    @wp.func
    def add_forces(
        group: int,
        first: int,
        last: int,
        time: Lanes,
        dt: Lanes,
        state: StateArrays,
        springs: SpringArrays,
        grips: SpringArrays,
        presses: PressArrays,
        nodes: int,
        parameters: ParameterArrays,
        effects: EffectArrays,
        forces: wp.array3d(dtype=Lanes),
    ):
        add_node_forces(group, first, last, time, dt, state, parameters, effects, forces)
        add_press_forces(group, first, last, nodes, dt, state, presses, parameters, forces)
        # Last, because going back their hand-written adjoints need the derivatives' arrays, which the adjoints that
        # Warp generates for the others replace by empty ones once they are done.
        add_grip_forces(group, first, last, state, grips, forces)
        if wp.static(has_laws):
            if effects.law[group] == wp.static(NO_LAW):
                add_spring_forces(group, first, last, state, springs, parameters, forces)
        else:
            add_spring_forces(group, first, last, state, springs, parameters, forces)

    return add_forces


@wp.func
def has_begun(time: Lanes) -> Lanes:
    """0 in the first substep of a rollout, 1 then."""
    begun = Lanes()
    for lane in range(LANES):
        begun[lane] = wp.step(-time[lane])
    return begun


@cache
def lawful_sum(terms: EffectTerms, alone: int) -> wp.Function:
    """The springs of lane groups with a spring law: a loop for each law up to number `alone`, and one for several."""
    add_several = lawful_springs(terms.laws, len(terms.forces), -1)
    if alone < 0:

        @wp.func
        def add_lawful(
            group: int,
            first: int,
            last: int,
            time: Lanes,
            dt: Lanes,
            state: StateArrays,
            springs: SpringArrays,
            parameters: ParameterArrays,
            effects: EffectArrays,
            remembered: wp.array3d(dtype=Lanes),
            forces: wp.array3d(dtype=Lanes),
        ):
            if effects.law[group] == wp.static(SEVERAL_LAWS):
                add_several(
                    group,
                    first,
                    last,
                    dt,
                    has_begun(time),
                    state,
                    springs,
                    parameters,
                    effects,
                    remembered,
                    forces,
                )

        return add_lawful
    add_before = lawful_sum(terms, alone - 1)
    add_alone = lawful_springs(terms.laws, len(terms.forces), alone)

    @wp.func
    def add_each_lawful(
        group: int,
        first: int,
        last: int,
        time: Lanes,
        dt: Lanes,
        state: StateArrays,
        springs: SpringArrays,
        parameters: ParameterArrays,
        effects: EffectArrays,
        remembered: wp.array3d(dtype=Lanes),
        forces: wp.array3d(dtype=Lanes),
    ):
        if effects.law[group] == wp.static(alone):
            add_alone(group, first, last, dt, has_begun(time), state, springs, parameters, effects, remembered, forces)
        else:
            add_before(group, first, last, time, dt, state, springs, parameters, effects, remembered, forces)

    return add_each_lawful


@cache
def all_lawful(terms: EffectTerms | None) -> wp.Function:
    """The springs of lane groups with a spring law, in the state itself; nothing where no law is known."""
    if terms is None or not terms.laws:

        @wp.func
        def add_nothing(
            group: int,
            nodes: int,
            time: Lanes,
            dt: Lanes,
            state: StateArrays,
            springs: SpringArrays,
            parameters: ParameterArrays,
            effects: EffectArrays,
            forces: wp.array3d(dtype=Lanes),
        ):
            pass

        return add_nothing
    add_lawful = lawful_sum(terms, len(terms.laws) - 1)

    @wp.func
    def add_all_lawful(
        group: int,
        nodes: int,
        time: Lanes,
        dt: Lanes,
        state: StateArrays,
        springs: SpringArrays,
        parameters: ParameterArrays,
        effects: EffectArrays,
        forces: wp.array3d(dtype=Lanes),
    ):
        if effects.law[group] != wp.static(NO_LAW):
            add_lawful(group, 0, nodes, time, dt, state, springs, parameters, effects, state.memory, forces)

    return add_all_lawful


@cache
def frame_kernel(terms: EffectTerms | None) -> wp.Kernel:
    """All substeps of a frame for one lane group, in place; to be launched with dim = G on a CPU."""
    add_forces, add_lawful = force_sum(terms), all_lawful(terms)

    @wp.kernel(enable_backward=False, module="unique")
    def advance_frame(
        state: StateArrays,
        forces: wp.array3d(dtype=Lanes),
        springs: SpringArrays,
        grips: SpringArrays,
        presses: PressArrays,
        controllers: ControllerArrays,
        parameters: ParameterArrays,
        rods: RodArrays,
        nudging: NudgingArrays,
        effects: EffectArrays,
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
            add_held_forces(group, 0, nodes, nodes, state, parameters, rods, nudging, forces)
            add_forces(group, 0, nodes, time, dt, state, springs, grips, presses, nodes, parameters, effects, forces)
            add_lawful(group, nodes, time, dt, state, springs, parameters, effects, forces)
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
