"""Loads: what acts on each rollout for a frame, decided on the host from its state at the frame's start.

Effects of a twin and the pull towards observations act this way. A frame is short against what they describe; where
that is not so, for forces that depend on the velocity, a load has a drag that the substeps apply.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from egophys_core.effects.effect import Action, Scene
from egophys_core.simulation.batch import Pull, RolloutBatch
from egophys_core.simulation.frames import into_record, into_world_directions
from egophys_core.simulation.lanes import Lanes
from egophys_core.simulation.state import ParameterArrays, StateArrays
from egophys_core.simulation.terms.force_effect import ForceEffect

PER_NODE = 4
"""Numbers of a node's load: an acceleration, m/s^2, and a drag, 1/s."""

LEAST_STIFFNESS_FACTOR, LARGEST_STIFFNESS_FACTOR = 0.05, 20.0
"""Effects on a spring's stiffness are kept between these: a spring never turns over, substeps stay affordable."""


@wp.func
def add_node_loads(
    group: int,
    first: int,
    last: int,
    column: int,
    time: Lanes,
    state: StateArrays,
    parameters: ParameterArrays,
    numbers: wp.array2d(dtype=Lanes),
    forces: wp.array3d(dtype=Lanes),
):
    """Add m (a - d v) of each node, N."""
    for node in range(first, last):
        mass = parameters.masses[group, node]
        at = column + node * PER_NODE
        drag = numbers[group, at + 3]
        for axis in range(3):
            change = numbers[group, at + axis] - wp.cw_mul(drag, state.velocities[group, node, axis])
            forces[group, node, axis] += wp.cw_mul(mass, change)


def with_actions(
    batch: RolloutBatch, actions: tuple[tuple[Action, ...], ...], *, pull: Pull | None = None
) -> RolloutBatch:
    """The batch with further actions, K tuples of them, one per rollout, and what draws all rollouts alike.

    They come with an effect that brings their loads to the kernels, the last one of the batch.
    """
    if not any(actions) and pull is None:
        return batch
    joined = tuple((*old, *new) for old, new in zip(batch.actions, actions, strict=True)) if batch.actions else actions
    effects = batch.effects
    if not batch.actions:
        numbers = np.zeros((batch.count, PER_NODE * batch.positions.shape[1]), np.float32)
        effects = (*effects, ForceEffect(add_forces=add_node_loads, numbers=numbers))
    return replace(batch, actions=joined, pull=pull or batch.pull, effects=effects)


class Loads:
    """The loads of a batch's actions, frame after frame."""

    def __init__(self, batch: RolloutBatch) -> None:
        self.batch = batch
        self.memories: list[list[Any]] = [[None] * len(actions) for actions in batch.actions]
        self.grip_shifts = np.zeros((batch.count, batch.controls[0].positions.shape[1], 3))
        """[K, C, 3] metres, at the start of the frame."""
        self.numbers = batch.effects[-1].numbers.copy()
        """[K, N PER_NODE], the node loads."""
        self.stiffness, self.rest_lengths = batch.stiffness.copy(), batch.rest_lengths.copy()
        """[K, E], as loaded."""
        self.springs_change = False
        """Whether any load has changed springs since the last frame."""

    def act(self, time: float, positions: np.ndarray, scenes: list[Scene | None]) -> np.ndarray:
        """Let the pull and all actions act on the rollouts.

        Args:
            time: seconds since the start of the episode.
            positions: [K, N, 3] metres, of the nodes, world; not finite where a rollout diverged.
            scenes: K, None where a rollout diverged or has no actions.

        Returns:
            [K, C, 3] metres: where controller points are at the end of the frame, away from their record.
        """
        node_loads = self._pulls(time, positions)
        shifts = np.zeros_like(self.grip_shifts)
        self.springs_change = False
        for row, scene in enumerate(scenes):
            if scene is None:
                continue
            factor, rest_shift = None, None
            for index, action in enumerate(self.batch.actions[row]):
                load, self.memories[row][index] = action(scene, self.memories[row][index])
                if load.acceleration is not None:
                    node_loads[row, :, :3] += load.acceleration
                if load.drag is not None:
                    node_loads[row, :, 3] += load.drag
                if load.stiffness_factor is not None:
                    factor = load.stiffness_factor if factor is None else factor * load.stiffness_factor
                if load.rest_shift is not None:
                    rest_shift = load.rest_shift if rest_shift is None else rest_shift + load.rest_shift
                if load.grip_shift is not None:
                    shifts[row] += load.grip_shift
            if factor is not None:
                factor = np.clip(factor, LEAST_STIFFNESS_FACTOR, LARGEST_STIFFNESS_FACTOR)
                self.stiffness[row] = self.batch.stiffness[row] * factor
            if rest_shift is not None:
                self.rest_lengths[row] = self.batch.rest_lengths[row] + rest_shift
            self.springs_change |= factor is not None or rest_shift is not None
        self.numbers[:] = node_loads.reshape(len(node_loads), -1)
        self.grip_shifts = shifts
        return shifts

    def _pulls(self, time: float, positions: np.ndarray) -> np.ndarray:
        """[K, N, PER_NODE] the pull on all rollouts, in the frames of their records; 0 where one diverged."""
        loads = np.zeros((*positions.shape[:2], PER_NODE))
        if self.batch.pull is None:
            return loads
        frames = self.batch.frames
        running = np.isfinite(positions).all(axis=(1, 2))
        there = positions[running].astype(np.float64)
        acceleration, drag = self.batch.pull(time, there if frames is None else into_record(there, frames[running]))
        loads[running, :, :3] = acceleration if frames is None else into_world_directions(acceleration, frames[running])
        loads[running, :, 3] = drag
        return loads

    def stiffening(self) -> np.ndarray:
        """[K] largest factor, at least 1, by which the present loads stiffen a spring of each rollout."""
        present = np.where(self.batch.stiffness > 0, self.batch.stiffness, 1.0)
        factor = np.where(self.batch.stiffness > 0, self.stiffness / present, 1.0)
        return np.maximum(factor.max(axis=1, initial=1.0), 1.0)
