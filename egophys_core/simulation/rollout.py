"""Rolling out a batch: frames on the host, substeps in the kernels."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import warp as wp

from egophys_core.errors import SimulationError
from egophys_core.simulation import step
from egophys_core.simulation.attachments import NOTHING_HELD, Attachments, attach
from egophys_core.simulation.batch import RolloutBatch
from egophys_core.simulation.controllers import ControllerArrays
from egophys_core.simulation.lanes import LANES, Lanes, group_count, pack, unpack
from egophys_core.simulation.springs import UNLIMITED, SpringArrays
from egophys_core.simulation.stability import largest_eigenvalue, stable_substeps
from egophys_core.simulation.state import ParameterArrays, StateArrays

MOST_SUBSTEPS = 5000
"""A frame that needs more is refused: the stiffness or damping is out of any physical range."""


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """What K rollouts did."""

    times: np.ndarray
    """[F] float64, seconds."""
    positions: np.ndarray
    """[K, F, N, 3] float32, metres, world; not finite from where a rollout diverged."""
    velocities: np.ndarray
    """[K, N, 3] float32, m/s, at the end."""
    substeps: np.ndarray
    """[K] int, most substeps any frame needed."""
    failures: tuple[str | None, ...]
    """Per rollout None, or what went wrong: node, time and likely cause."""

    def raise_on_failure(self) -> None:
        """Raise SimulationError for the first rollout that failed."""
        for index, failure in enumerate(self.failures):
            if failure is not None:
                raise SimulationError(f"rollout {index}: {failure}")


def rollout(batch: RolloutBatch, *, device: str = "cpu") -> Rollout:
    """Advance all rollouts of a batch over the frames of their controls.

    On the CPU lane groups run on all cores; a rollout's numbers do not depend on the batch it is in.

    Args:
        device: a Warp device, "cpu" or "cuda:0".

    Raises:
        SimulationError: a rollout would need more than `MOST_SUBSTEPS` substeps a frame.
    """
    wp.load_module(step, device=device)
    if not wp.get_device(device).is_cpu:
        return _run(batch, device)
    groups = group_count(batch.count)
    workers = min(groups, os.cpu_count() or 1)
    # Rollouts of similar stiffness share a lane group: it runs as many substeps as its stiffest one needs.
    order = np.argsort(batch.stiffness.max(axis=1, initial=0.0) / batch.masses.min(axis=1), kind="stable")
    bounds = np.linspace(0, groups, workers + 1).astype(int) * LANES
    parts = [batch.part(order[first:last]) for first, last in pairwise(bounds)]
    with ThreadPoolExecutor(workers) as pool:
        results = list(pool.map(_run, parts, [device] * workers))
    back = np.argsort(order)
    failures = [failure for result in results for failure in result.failures]
    return Rollout(
        times=results[0].times,
        positions=np.concatenate([result.positions for result in results])[back],
        velocities=np.concatenate([result.velocities for result in results])[back],
        substeps=np.concatenate([result.substeps for result in results])[back],
        failures=tuple(failures[row] for row in back),
    )


def _run(batch: RolloutBatch, device: str) -> Rollout:
    times = batch.controls[0].times
    nodes = batch.positions.shape[1]
    controllers = np.stack([controls.positions for controls in batch.controls]).astype(np.float32)
    hold = np.stack([controls.hold for controls in batch.controls])
    controller_velocities = np.gradient(controllers.astype(np.float64), times, axis=1)
    motion = [_per_frame(values, device) for values in (controllers, controller_velocities)]
    state = _initial_state(batch, controllers[:, 0], controller_velocities[:, 0], device)
    parameters = _parameters(batch, device)
    attachments = [NOTHING_HELD] * batch.count
    held = np.zeros_like(hold[:, 0])
    springs, substeps = SpringArrays(), np.zeros(batch.count, int)
    most_substeps = np.zeros(batch.count, int)
    positions = np.empty((batch.count, len(times), nodes, 3), np.float32)
    positions[:, 0] = batch.positions

    for frame in range(len(times) - 1):
        duration = times[frame + 1] - times[frame]
        if frame == 0 or (hold[:, frame] != held).any():
            attachments = [
                _update_attachments(batch, row, attachments[row], held[row], hold[row, frame], here, points)
                for row, (here, points) in enumerate(zip(positions[:, frame], controllers[:, frame], strict=True))
            ]
            held = hold[:, frame]
            springs, rates = _springs(batch, attachments, device)
            substeps = np.zeros(batch.count, int)
        if frame == 0 or not substeps.any() or duration != times[frame] - times[frame - 1]:
            substeps = np.array([stable_substeps(duration, *rate) for rate in rates])
            if substeps.max() > MOST_SUBSTEPS:
                row = int(substeps.argmax())
                raise SimulationError(
                    f"rollout {row} needs {substeps[row]} substeps for a frame of {duration:.4f} s, at most "
                    f"{MOST_SUBSTEPS}: stiffness {batch.parameters[row].stiffness:g} N/m or damping "
                    f"{batch.parameters[row].damping:g} N s/m is too large for nodes of "
                    f"{batch.masses[row].min():g} kg; lower it or its bound"
                )
            most_substeps = np.maximum(most_substeps, substeps)
            parameters.substeps = wp.array(pack(substeps), dtype=Lanes, device=device)
            parameters.frame_duration = wp.array(pack(np.full(batch.count, duration)), dtype=Lanes, device=device)
        _launch_frame(int(substeps.max()), state, springs, _frame_motion(motion, frame), parameters, device)
        positions[:, frame + 1] = unpack(state.positions.numpy(), batch.count)[:, :nodes]

    return Rollout(
        times=times,
        positions=positions,
        velocities=unpack(state.velocities.numpy(), batch.count)[:, :nodes].astype(np.float32),
        substeps=most_substeps,
        failures=tuple(_failure(times, positions[row], most_substeps[row]) for row in range(batch.count)),
    )


def _launch_frame(
    substeps: int,
    state: StateArrays,
    springs: SpringArrays,
    controllers: ControllerArrays,
    parameters: ParameterArrays,
    device: str,
) -> None:
    groups = state.positions.shape[0]
    if wp.get_device(device).is_cpu:
        wp.launch(
            step.advance_frame,
            dim=groups,
            inputs=[substeps, state, springs, controllers, parameters],
            device=device,
        )
        return
    for substep in range(substeps):
        wp.launch(
            step.gather_forces,
            dim=(groups, state.node_count),
            inputs=[state, springs, parameters],
            device=device,
        )
        wp.launch(
            step.advance_substep,
            dim=(groups, state.node_count + state.controller_count),
            inputs=[substep, state, controllers, parameters],
            device=device,
        )


def _initial_state(
    batch: RolloutBatch, controllers: np.ndarray, controller_velocities: np.ndarray, device: str
) -> StateArrays:
    points = np.concatenate([batch.positions, controllers], axis=1)
    speeds = np.concatenate([batch.velocities, controller_velocities], axis=1)
    state = StateArrays()
    state.positions = wp.array(pack(points), dtype=Lanes, device=device)
    state.velocities = wp.array(pack(speeds), dtype=Lanes, device=device)
    state.forces = wp.zeros((group_count(batch.count), batch.positions.shape[1], 3), dtype=Lanes, device=device)
    state.node_count = batch.positions.shape[1]
    state.controller_count = controllers.shape[1]
    return state


def _parameters(batch: RolloutBatch, device: str) -> ParameterArrays:
    def lanes(values: list[float]) -> wp.array:
        return wp.array(pack(np.array(values, np.float32)), dtype=Lanes, device=device)

    arrays = ParameterArrays()
    arrays.masses = wp.array(pack(batch.masses), dtype=Lanes, device=device)
    for name in (
        "gravity",
        "drag",
        "strain_limit",
        "restitution",
        "friction",
        "ground_projection",
        "contact_threshold",
    ):
        setattr(arrays, name, lanes([getattr(parameters, name) for parameters in batch.parameters]))
    arrays.contact_height = lanes([batch.ground_height + each.contact_radius for each in batch.parameters])
    return arrays


def _per_frame(values: np.ndarray, device: str) -> list[wp.array]:
    """[K, F, C, 3] as one array [G, C, 3] of Lanes per frame."""
    return [wp.array(pack(values[:, frame]), dtype=Lanes, device=device) for frame in range(values.shape[1])]


def _frame_motion(motion: list[list[wp.array]], frame: int) -> ControllerArrays:
    positions, velocities = motion
    arrays = ControllerArrays()
    arrays.start_positions, arrays.end_positions = positions[frame], positions[frame + 1]
    arrays.start_velocities, arrays.end_velocities = velocities[frame], velocities[frame + 1]
    return arrays


def _update_attachments(
    batch: RolloutBatch,
    row: int,
    attachments: Attachments,
    held: np.ndarray,
    hold: np.ndarray,
    nodes: np.ndarray,
    controllers: np.ndarray,
) -> Attachments:
    parameters = batch.parameters[row]
    new = attach(
        nodes,
        controllers,
        hold & ~held,
        radius=parameters.controller_radius,
        max_neighbours=parameters.controller_neighbours,
        flat=batch.flat,
    )
    return attachments.of_controllers(hold & held).joined(new)


def _springs(
    batch: RolloutBatch, attachments: list[Attachments], device: str
) -> tuple[SpringArrays, list[tuple[float, float]]]:
    """Rows of springs for the kernels, and per rollout the largest stiffness and damping rates."""
    nodes, graph = batch.positions.shape[1], len(batch.springs)
    held_nodes, held_controllers, columns = _union(attachments, batch.controls[0].positions.shape[1])
    stiffness = np.zeros((batch.count, graph + len(held_nodes)), np.float32)
    damping, rest = np.zeros_like(stiffness), np.ones_like(stiffness)
    stiffness[:, :graph], damping[:, :graph], rest[:, :graph] = (
        batch.stiffness,
        batch.damping,
        batch.rest_lengths,
    )
    for row, (held, column) in enumerate(zip(attachments, columns, strict=True)):
        stiffness[row, graph + column] = batch.parameters[row].controller_stiffness
        damping[row, graph + column] = batch.parameters[row].damping
        rest[row, graph + column] = held.rest_lengths
    pairs = np.concatenate([batch.springs, np.stack([held_nodes, nodes + held_controllers], axis=1)])
    rates = [
        (largest_eigenvalue(pairs, k, m), largest_eigenvalue(pairs, g, m))
        for k, g, m in zip(stiffness, damping, batch.masses, strict=True)
    ]

    # Each spring goes into the rows of both its nodes; controller points have no rows of their own.
    node = np.concatenate([pairs[:, 0], pairs[:graph, 1]])
    neighbour = np.concatenate([pairs[:, 1], pairs[:graph, 0]])
    spring = np.concatenate([np.arange(len(pairs)), np.arange(graph)])
    order = np.lexsort((neighbour, node))
    node, neighbour, spring = node[order], neighbour[order], spring[order]
    starts = np.searchsorted(node, np.arange(nodes + 1))
    extra_strain = np.where(neighbour < nodes, 0.0, UNLIMITED)
    arrays = SpringArrays()
    arrays.starts = wp.array(starts.astype(np.int32), dtype=int, device=device)
    arrays.neighbours = wp.array(neighbour.astype(np.int32), dtype=int, device=device)
    arrays.extra_strain = wp.array(extra_strain.astype(np.float32), dtype=float, device=device)
    arrays.stiffness = wp.array(pack(stiffness[:, spring]), dtype=Lanes, device=device)
    arrays.damping = wp.array(pack(damping[:, spring]), dtype=Lanes, device=device)
    arrays.rest_lengths = wp.array(pack(rest[:, spring]), dtype=Lanes, device=device)
    return arrays, rates


def _union(attachments: list[Attachments], controller_count: int) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Node and controller of every pair held in any rollout, and where each rollout's pairs stand there."""
    codes = [held.nodes.astype(np.int64) * max(controller_count, 1) + held.controllers for held in attachments]
    union = np.unique(np.concatenate(codes))
    columns = [np.searchsorted(union, code) for code in codes]
    return union // max(controller_count, 1), union % max(controller_count, 1), columns


def _failure(times: np.ndarray, positions: np.ndarray, substeps: int) -> str | None:
    finite = np.isfinite(positions).all(axis=2)
    if finite.all():
        return None
    frame, node = np.argwhere(~finite)[0]
    return (
        f"position not finite at frame {frame} (t={times[frame]:.3f} s), node {node}, with {substeps} substeps a "
        "frame; lower the stiffness or damping bound, or check the controller motion for jumps"
    )
