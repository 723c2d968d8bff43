"""The functions of a substep as kernels from one set of arrays to the next, each thread on some rows of nodes.

They run the simulator on a GPU, and on any device where gradients are wanted: nothing that is read is overwritten.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from egophys_core.lanes import Lanes
from egophys_core.lanes.state import FrameArrays, ParameterArrays, StateArrays, substep_duration, substep_time
from egophys_core.simulation.collision.self_collision import (
    PairArrays,
    add_contact_impulses,
    apply_changes,
    count_contacts,
)
from egophys_core.simulation.integrator import drift, find_divergence, kick
from egophys_core.simulation.step import add_held_forces, force_sum, has_begun
from egophys_core.simulation.terms.controllers import ControllerArrays, move_controllers
from egophys_core.simulation.terms.effects import NO_LAW, EffectArrays, EffectTerms
from egophys_core.simulation.terms.material_frames import RodArrays
from egophys_core.simulation.terms.nudging import NudgingArrays
from egophys_core.simulation.terms.presses import PressArrays
from egophys_core.simulation.terms.spring_adjoint import adj_add_spring_forces as adj_add_spring_forces
from egophys_core.simulation.terms.spring_laws import lawful_springs
from egophys_core.simulation.terms.springs import SpringArrays


@cache
def forces_kernel(terms: EffectTerms | None) -> wp.Kernel:
    """Sum of all terms but those before and springs with a law; dim = (G, ceil(N / rows)) on forces that are 0."""
    add_forces = force_sum(terms)

    @wp.kernel(module="unique")
    def sum_forces(
        rows: int,
        substep: int,
        state: StateArrays,
        springs: SpringArrays,
        grips: SpringArrays,
        presses: PressArrays,
        parameters: ParameterArrays,
        effects: EffectArrays,
        frame: FrameArrays,
        forces: wp.array3d(dtype=Lanes),
    ):
        group, part = wp.tid()
        nodes = frame.node_count
        last = wp.min((part + 1) * rows, nodes)
        time = substep_time(group, substep, frame)
        dt = substep_duration(group, substep, frame)
        add_forces(
            group, part * rows, last, time, dt, state, springs, grips, presses, nodes, parameters, effects, forces
        )

    return sum_forces


@cache
def lawful_kernel(terms: EffectTerms) -> wp.Kernel:
    """The springs with a law, added to the sum of the other terms: apart from these, as Warp generates its adjoint."""
    add_lawful = lawful_springs(terms.laws, len(terms.forces), -1)

    @wp.kernel(module="unique")
    def sum_lawful(
        rows: int,
        substep: int,
        state: StateArrays,
        springs: SpringArrays,
        parameters: ParameterArrays,
        effects: EffectArrays,
        frame: FrameArrays,
        forces: wp.array3d(dtype=Lanes),
        after: StateArrays,
    ):
        group, part = wp.tid()
        if effects.law[group] != wp.static(NO_LAW):
            last = wp.min((part + 1) * rows, frame.node_count)
            begun = has_begun(substep_time(group, substep, frame))
            dt = substep_duration(group, substep, frame)
            add_lawful(group, part * rows, last, dt, begun, state, springs, parameters, effects, after.memory, forces)

    return sum_lawful


@wp.kernel(enable_backward=False)
def sum_held(
    rows: int,
    state: StateArrays,
    parameters: ParameterArrays,
    rods: RodArrays,
    nudging: NudgingArrays,
    frame: FrameArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Bending and nudging, the first terms of the sum."""
    group, part = wp.tid()
    nodes = frame.node_count
    add_held_forces(
        group, part * rows, wp.min((part + 1) * rows, nodes), nodes, state, parameters, rods, nudging, forces
    )


@wp.kernel
def kick_nodes(
    rows: int,
    substep: int,
    state: StateArrays,
    forces: wp.array3d(dtype=Lanes),
    parameters: ParameterArrays,
    frame: FrameArrays,
    kicked: wp.array3d(dtype=Lanes),
):
    """Velocities after the forces."""
    group, part = wp.tid()
    last = wp.min((part + 1) * rows, frame.node_count)
    dt = substep_duration(group, substep, frame)
    kick(group, part * rows, last, dt, state, forces, parameters, kicked)


@wp.kernel(enable_backward=False)
def count_node_contacts(
    rows: int,
    state: StateArrays,
    velocities: wp.array3d(dtype=Lanes),
    pairs: PairArrays,
    contacts: wp.array2d(dtype=Lanes),
):
    """How many other nodes each node collides with on counts that are 0."""
    group, part = wp.tid()
    last = wp.min((part + 1) * rows, contacts.shape[1])
    count_contacts(group, part * rows, last, state.positions, velocities, pairs, contacts)


@wp.kernel
def collide_nodes(
    rows: int,
    state: StateArrays,
    velocities: wp.array3d(dtype=Lanes),
    parameters: ParameterArrays,
    pairs: PairArrays,
    contacts: wp.array2d(dtype=Lanes),
    changes: wp.array3d(dtype=Lanes),
):
    """Velocity changes by self-collision on changes that are 0."""
    group, part = wp.tid()
    add_contact_impulses(
        group,
        part * rows,
        wp.min((part + 1) * rows, contacts.shape[1]),
        state.positions,
        velocities,
        parameters.masses,
        pairs,
        contacts,
        parameters.collision_restitution[group],
        parameters.collision_friction[group],
        changes,
    )


@wp.kernel
def change_velocities(
    rows: int,
    substep: int,
    velocities: wp.array3d(dtype=Lanes),
    changes: wp.array3d(dtype=Lanes),
    frame: FrameArrays,
    collided: wp.array3d(dtype=Lanes),
):
    """Velocities after self-collision."""
    group, part = wp.tid()
    last = wp.min((part + 1) * rows, frame.node_count)
    dt = substep_duration(group, substep, frame)
    apply_changes(group, part * rows, last, dt, velocities, changes, collided)


@wp.kernel
def drift_nodes(
    rows: int,
    substep: int,
    state: StateArrays,
    velocities: wp.array3d(dtype=Lanes),
    controllers: ControllerArrays,
    parameters: ParameterArrays,
    frame: FrameArrays,
    after: StateArrays,
):
    """Positions after the substep, and the controllers' motion."""
    group, part = wp.tid()
    nodes = frame.node_count
    first = part * rows
    last = wp.min((part + 1) * rows, nodes + frame.controller_count)
    dt = substep_duration(group, substep, frame)
    drift(group, first, wp.min(last, nodes), dt, state.positions, velocities, parameters, after)
    move_controllers(group, wp.max(first, nodes) - nodes, last - nodes, substep, controllers, frame, after)


@wp.kernel(enable_backward=False)
def find_divergences(substep: int, state: StateArrays, frame: FrameArrays):
    """Record rollouts that diverged in this substep."""
    group, node = wp.tid()
    find_divergence(group, node, node + 1, substep, state.velocities, frame)


@dataclass(frozen=True, kw_only=True)
class FrameInputs:
    """What the substeps of a frame read besides the state."""

    springs: SpringArrays
    grips: SpringArrays
    presses: PressArrays
    controllers: ControllerArrays
    parameters: ParameterArrays
    rods: RodArrays
    nudging: NudgingArrays
    terms: EffectTerms | None
    """What the kernels are composed of beside the base simulator."""
    effects: EffectArrays
    pairs: PairArrays
    frame: FrameArrays


@dataclass(frozen=True, kw_only=True)
class SubstepArrays:
    """What one substep writes; all `Lanes`."""

    forces: wp.array
    """[G, N, 3] newtons."""
    kicked: wp.array
    """[G, N, 3] m/s, velocities after the forces."""
    contacts: wp.array
    """[G, N] self-collisions of each node."""
    changes: wp.array
    """[G, N, 3] m/s, velocity changes by self-collision."""
    collided: wp.array
    """[G, N, 3] m/s, velocities after self-collision."""
    after: StateArrays


Launch = tuple[wp.Kernel, tuple[int, int], list[Any], list[Any]]
"""Kernel, threads, inputs, outputs."""


def substep_launches(substep: int, state: StateArrays, inputs: FrameInputs, out: SubstepArrays) -> list[Launch]:
    """One substep from `state` to `out.after`; sums in `out` must be 0."""
    groups, nodes = out.contacts.shape
    points = nodes + inputs.frame.controller_count
    # A CPU runs threads one after the other, so one for each lane group does.
    rows = points if out.contacts.device.is_cpu else 1
    each_node, each_point = (groups, -(-nodes // rows)), (groups, -(-points // rows))
    parameters, frame, pairs = inputs.parameters, inputs.frame, inputs.pairs
    launches: list[Launch] = []
    if inputs.rods.bend or inputs.nudging.acts:
        held = [rows, state, parameters, inputs.rods, inputs.nudging, frame]
        launches.append((sum_held, each_node, held, [out.forces]))
    read = [rows, substep, state, inputs.springs, inputs.grips, inputs.presses, parameters, inputs.effects, frame]
    launches.append((forces_kernel(inputs.terms), each_node, read, [out.forces]))
    if inputs.terms is not None and inputs.terms.laws:
        lawful = [rows, substep, state, inputs.springs, parameters, inputs.effects, frame]
        launches.append((lawful_kernel(inputs.terms), each_node, lawful, [out.forces, out.after]))
    launches.append((kick_nodes, each_node, [rows, substep, state, out.forces, parameters, frame], [out.kicked]))
    velocities = out.kicked
    if pairs.count > 0:
        launches += [
            (count_node_contacts, each_node, [rows, state, velocities, pairs], [out.contacts]),
            (collide_nodes, each_node, [rows, state, velocities, parameters, pairs, out.contacts], [out.changes]),
            (change_velocities, each_node, [rows, substep, velocities, out.changes, frame], [out.collided]),
        ]
        velocities = out.collided
    moved = [rows, substep, state, velocities, inputs.controllers, parameters, frame]
    return [*launches, (drift_nodes, each_point, moved, [out.after])]


def launch_substep(substep: int, state: StateArrays, inputs: FrameInputs, out: SubstepArrays) -> None:
    """Do one substep from `state` to `out.after`; sums in `out` must be 0."""
    for kernel, dim, read, written in substep_launches(substep, state, inputs, out):
        wp.launch(kernel, dim=dim, inputs=read, outputs=written, device=out.forces.device)
