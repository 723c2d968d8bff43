"""A batch as arrays on a device."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from egophys_core.lanes import LANES, Lanes, group_count, pack
from egophys_core.lanes.state import RUNNING, FrameArrays, ParameterArrays, StateArrays
from egophys_core.simulation.attachments import Attachments
from egophys_core.simulation.batch import RolloutBatch
from egophys_core.simulation.substep import SubstepArrays
from egophys_core.simulation.terms.controllers import ControllerArrays
from egophys_core.simulation.terms.nudging import NudgingArrays
from egophys_core.simulation.terms.presses import PressArrays
from egophys_core.simulation.terms.springs import UNLIMITED, SpringArrays

SPRING_NAMES = ("stiffness", "damping", "rest_lengths", "longest_extensions")
"""Numbers of a spring: fields of `SpringArrays` and of `RolloutBatch`."""

FIRMNESS = 10.0
"""Stiffness and dashpot of a press over those of a spring: about as many keep a node in its place in the body."""

MOTION_NAMES = ("start_positions", "end_positions", "start_velocities", "end_velocities")
"""Fields of `ControllerArrays`."""

PARAMETER_NAMES = (
    "gravity",
    "drag",
    "added_mass",
    "compression_ratio",
    "restitution",
    "friction",
    "ground_projection",
    "contact_threshold",
    "collision_restitution",
    "collision_friction",
)
"""Fields of `ParameterArrays` that are fields of `PhysicalParameters` as well."""


def lanes_array(values: np.ndarray, device: str, *, requires_grad: bool = False) -> wp.array:
    """[K, ...] per rollout as an array [G, ...] of `Lanes`."""
    return wp.array(pack(values), dtype=Lanes, device=device, requires_grad=requires_grad)


def zeros(groups: int, *shape: int, device: str, requires_grad: bool = False) -> wp.array:
    """[G, *shape] of `Lanes`, all 0."""
    return wp.zeros((groups, *shape), dtype=Lanes, device=device, requires_grad=requires_grad)


def spring_arrays(batch: RolloutBatch, device: str, *, requires_grad: bool = False) -> SpringArrays:
    """The object's springs; `batch.springs` must be sorted by first node."""
    arrays = _rows(batch.springs[:, 0], batch.springs[:, 1], batch.positions.shape[1], device)
    for name in SPRING_NAMES:
        setattr(arrays, name, lanes_array(getattr(batch, name), device, requires_grad=requires_grad))
    return arrays


def grip_arrays(
    batch: RolloutBatch, attachments: Sequence[Attachments], device: str, *, requires_grad: bool = False
) -> tuple[SpringArrays, list[np.ndarray]]:
    """Springs of the holds of all rollouts, and per rollout where its own stand among them."""
    nodes, controllers = batch.positions.shape[1], batch.controls[0].positions.shape[1]
    codes = [
        held.nodes[held.holds].astype(np.int64) * max(controllers, 1) + held.controllers[held.holds]
        for held in attachments
    ]
    union = np.unique(np.concatenate(codes))
    columns = [np.searchsorted(union, code) for code in codes]
    values = {
        name: np.full((batch.count, len(union)), value, np.float32)
        for name, value in zip(SPRING_NAMES, (0.0, 0.0, 1.0, UNLIMITED), strict=True)
    }
    for row, (held, column) in enumerate(zip(attachments, columns, strict=True)):
        values["stiffness"][row, column] = batch.parameters[row].controller_stiffness
        values["damping"][row, column] = batch.parameters[row].damping
        values["rest_lengths"][row, column] = held.rest_lengths[held.holds]
    first, controller = union // max(controllers, 1), union % max(controllers, 1)
    arrays = _rows(first, nodes + controller, nodes, device)
    for name, value in values.items():
        setattr(arrays, name, lanes_array(value, device, requires_grad=requires_grad))
    return arrays, columns


def press_arrays(
    batch: RolloutBatch, attachments: Sequence[Attachments], device: str, *, requires_grad: bool = False
) -> tuple[PressArrays, list[np.ndarray]]:
    """The presses of all rollouts, and per rollout where its own stand among them."""
    pressing = [held.controllers[~held.holds] for held in attachments]
    union = np.unique(np.concatenate(pressing))
    columns = [np.searchsorted(union, controllers) for controllers in pressing]
    reaches = np.zeros((batch.count, len(union)), np.float32)
    for row, (held, column) in enumerate(zip(attachments, columns, strict=True)):
        reaches[row, column] = held.rest_lengths[~held.holds]
    arrays = PressArrays()
    arrays.count = len(union)
    arrays.controllers = wp.array(union.astype(np.int32), dtype=int, device=device)
    arrays.reaches = lanes_array(reaches, device, requires_grad=requires_grad)
    for name, values in (
        ("stiffness", [FIRMNESS * each.controller_stiffness for each in batch.parameters]),
        ("damping", [FIRMNESS * each.damping for each in batch.parameters]),
    ):
        setattr(arrays, name, lanes_array(np.array(values, np.float32), device, requires_grad=requires_grad))
    return arrays, columns


def parameter_arrays(batch: RolloutBatch, device: str, *, requires_grad: bool = False) -> ParameterArrays:
    """Masses and global parameters."""
    arrays = ParameterArrays()
    arrays.masses = lanes_array(batch.masses, device, requires_grad=requires_grad)
    arrays.inverse_masses = lanes_array(1.0 / batch.masses, device, requires_grad=requires_grad)
    for name in PARAMETER_NAMES:
        values = np.array([getattr(parameters, name) for parameters in batch.parameters], np.float32)
        setattr(arrays, name, lanes_array(values, device, requires_grad=requires_grad))
    heights = np.array([batch.ground_height + each.contact_radius for each in batch.parameters], np.float32)
    arrays.contact_height = lanes_array(heights, device, requires_grad=requires_grad)
    arrays.across = wp.array(batch.across, dtype=int, device=device)
    return arrays


def nudging_arrays(batch: RolloutBatch, device: str) -> NudgingArrays:
    """Nudging of no size, if there is any."""
    arrays = NudgingArrays()
    if batch.nudging is not None:
        shape = (group_count(batch.count), batch.positions.shape[1])
        arrays.acts = 1
        arrays.accelerations, arrays.drags = zeros(*shape, 3, device=device), zeros(*shape, device=device)
    return arrays


def controller_arrays(groups: int, controllers: int, device: str, *, requires_grad: bool = False) -> ControllerArrays:
    """Motion over one frame, all 0."""
    arrays = ControllerArrays()
    for name in MOTION_NAMES:
        setattr(arrays, name, zeros(groups, controllers, 3, device=device, requires_grad=requires_grad))
    return arrays


def state_arrays(
    positions: np.ndarray, velocities: np.ndarray, device: str, *, memory: tuple[int, int] = (0, 0)
) -> StateArrays:
    """Nodes and controller points [K, N + C, 3], metres and m/s, and springs that remember so many numbers each."""
    state = StateArrays()
    state.positions = lanes_array(positions, device)
    state.velocities = lanes_array(velocities, device)
    state.memory = zeros(group_count(len(positions)), *memory, device=device)
    return state


def substep_arrays(groups: int, nodes: int, controllers: int, memory: tuple[int, int], device: str) -> SubstepArrays:
    """What a substep writes, all 0; `memory` are the springs and how many numbers each of them remembers."""

    def node_vectors(count: int = nodes) -> wp.array:
        return zeros(groups, count, 3, device=device)

    after = StateArrays()
    after.positions, after.velocities = node_vectors(nodes + controllers), node_vectors(nodes + controllers)
    after.memory = zeros(groups, *memory, device=device)
    return SubstepArrays(
        forces=node_vectors(),
        kicked=node_vectors(),
        contacts=zeros(groups, nodes, device=device),
        changes=node_vectors(),
        collided=node_vectors(),
        after=after,
    )


def frame_arrays(batch: RolloutBatch, device: str) -> FrameArrays:
    """Nothing advanced yet."""
    groups = group_count(batch.count)
    frame = FrameArrays()
    frame.node_count, frame.controller_count = batch.positions.shape[1], batch.controls[0].positions.shape[1]
    frame.start, frame.duration, frame.substeps = (zeros(groups, device=device) for _ in range(3))
    frame.divergence = wp.full((groups, LANES), RUNNING, dtype=int, device=device)
    return frame


def _rows(first: np.ndarray, ends: np.ndarray, nodes: int, device: str) -> SpringArrays:
    arrays = SpringArrays()
    arrays.starts = wp.array(np.searchsorted(first, np.arange(nodes + 1)).astype(np.int32), dtype=int, device=device)
    arrays.ends = wp.array(ends.astype(np.int32), dtype=int, device=device)
    return arrays
