"""Gradients of a loss on rollouts, by Warp's tape, a frame at a time.

The forward pass keeps the state at the start of every frame. Going back, each frame's substeps are run again from
there on a tape, so memory holds one state per frame and the substeps of one frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from egophys_core.errors import SimulationError
from egophys_core.lanes import pack, unpack
from egophys_core.simulation.attachments import NOTHING_HELD, Attachments
from egophys_core.simulation.batch import RolloutBatch
from egophys_core.simulation.codebook_arrays import held_nodes
from egophys_core.simulation.collision.self_collision import PairArrays
from egophys_core.simulation.device_arrays import FIRMNESS, MOTION_NAMES, PARAMETER_NAMES, SPRING_NAMES
from egophys_core.simulation.engine import Engine, Segment
from egophys_core.simulation.frame_tape import FrameTape
from egophys_core.simulation.frames import into_world_directions
from egophys_core.simulation.rollout import Rollout, advance_all, in_frames
from egophys_core.simulation.substep import FrameInputs
from egophys_core.simulation.terms.springs import SHORTEST_LENGTH
from egophys_core.simulation.turns import turn_on

GRIP_NAMES = ("stiffness", "damping", "rest_lengths")
"""Numbers of the springs of holds that have derivatives."""

PRESS_NAMES = ("reaches", "stiffness", "damping")
"""Numbers of presses that have derivatives."""

ThroughCodebook = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From rows of rollouts as the codebook was asked, positions and velocities [R, N, 3], nodes that hands hold [R, N] and
the derivatives [R, E] of the loss by the stiffness that the codebook gave there: its derivatives [R, N, 3] by those
positions and velocities."""

Loss = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From positions [K, F, N, 3], metres: the loss [K] of each rollout, and its gradient [K, F, N, 3] by them."""


@dataclass(frozen=True, kw_only=True)
class Gradient:
    """Derivatives of each rollout's loss by its own inputs, in units of the loss over those of the input."""

    stiffness: np.ndarray
    """[K, E], by the anchors where there is a codebook."""
    damping: np.ndarray
    """[K, E]."""
    rest_lengths: np.ndarray
    """[K, E]."""
    longest_extensions: np.ndarray
    """[K, E]."""
    controller_stiffness: np.ndarray
    """[K]."""
    controller_damping: np.ndarray
    """[K], by the dashpot of controller springs and presses."""
    parameters: dict[str, np.ndarray]
    """[K] by name: those of `PARAMETER_NAMES`, and `contact_height`."""
    masses: np.ndarray
    """[K, N]."""
    effects: np.ndarray
    """[K, P] by the numbers of all effects side by side; one column of zeros without any."""
    frames: np.ndarray
    """[K, 4, 4] by the frames in which results are given, for what they do to these; zeros if all are the world."""
    controls: np.ndarray
    """[K, F, C, 3]."""
    slides: np.ndarray
    """[K, F - 1, C, 3] by how far what is held slides through hands in each frame; zeros where nothing does."""
    pulls: np.ndarray
    """[K, F - 1, C, 3] what pulled on them as the frames began, over the weight: what laws of sliding were told."""
    positions: np.ndarray
    """[K, N, 3], by the start positions."""
    velocities: np.ndarray
    """[K, N, 3], by the start velocities."""


def differentiate(
    batch: RolloutBatch,
    loss: Loss,
    *,
    windows: int = 1,
    through_codebook: ThroughCodebook | None = None,
    device: str = "cpu",
) -> tuple[Rollout, np.ndarray, Gradient]:
    """Roll out a batch, and go back from its loss to everything it depends on.

    A rollout that diverges has zero gradient. Contacts are differentiated as they happened: which nodes hit the
    table, which are held, where these pull to and the number of substeps are taken as fixed.

    Args:
        windows: into how many windows of frames each rollout is cut. Derivatives do not pass from a window to the one
            before it (truncated back-propagation); in return all windows go back at once, as lanes. 1 is exact.
        through_codebook: passes derivatives on through the codebook of the batch, each time it was asked; without
            it the stiffness that a codebook gives is differentiated by its anchors alone.

    Returns:
        The rollout, the loss [K] and its gradient.
    """
    if windows < 1:
        raise SimulationError(f"windows must be at least 1, got {windows}")
    if batch.nudging is not None:
        raise SimulationError("nudged rollouts have no derivatives; differentiate the batch without nudging")
    if batch.rods is not None:
        raise SimulationError(
            "rods have no derivatives: how their material frames turn is not on the tape; use differences"
        )
    with turn_on(device):
        return _forward_and_back(Engine(batch, device), loss, windows, through_codebook)


def _forward_and_back(
    engine: Engine, loss: Loss, windows: int, through_codebook: ThroughCodebook | None
) -> tuple[Rollout, np.ndarray, Gradient]:
    batch = engine.batch
    states: list[tuple[np.ndarray, ...]] = []

    def keep() -> None:
        state = engine.state
        states.append(tuple(each.numpy().copy() for each in (state.positions, state.velocities, state.memory)))

    in_world = advance_all(engine, before_frame=keep)
    result = in_frames(in_world, batch.frames)
    losses, seeds = loss(result.positions)
    running = np.array([failure is None for failure in result.failures])
    seeds = np.where(running[:, None, None, None], seeds, 0.0)
    by_frames = np.zeros((batch.count, 4, 4))
    if batch.frames is not None:
        # A point is recorded at R p + t.
        places = np.where(running[:, None, None, None], in_world.positions.astype(np.float64), 0.0)
        by_frames[:, :3, :3] = np.einsum("kfni,kfnj->kij", seeds, places)
        by_frames[:, :3, 3] = seeds.sum(axis=(1, 2))
        seeds = into_world_directions(seeds, batch.frames)
    gradient = _BackwardPass(engine, states, running, windows, through_codebook).run(seeds)
    return result, losses, replace(gradient, frames=by_frames)


class _BackwardPass:
    """What is summed up while going back over the frames, in float64. Row r is window r % W of rollout r // W."""

    def __init__(
        self,
        forward: Engine,
        states: list[tuple[np.ndarray, ...]],
        running: np.ndarray,
        windows: int,
        through_codebook: ThroughCodebook | None,
    ) -> None:
        count = forward.batch.count
        self.forward, self.running, self.windows = forward, running, windows
        self.through_codebook = through_codebook
        self.rollouts = np.repeat(np.arange(count), windows)
        self.engine = Engine(forward.batch.rows(self.rollouts), forward.device, requires_grad=True)
        self.sliding = forward.sliding
        if self.sliding is not None:
            self.engine.sliding = self.sliding.rows(self.rollouts)
        # [F - 1, K, N + C, 3] twice and [F - 1, K, E, M], at the start of each frame.
        self.positions, self.velocities, self.memory = (
            np.stack([unpack(values, count) for values in kept]) for kept in zip(*states, strict=True)
        )
        self.nodes, self.controllers = self.engine.nodes, self.engine.controllers.shape[2]
        self.controls = np.zeros(forward.controllers.shape)
        self.control_velocities = np.zeros(forward.controllers.shape)
        self.by_slid, self.by_slides = np.zeros_like(self.controls[:, 1:]), np.zeros_like(self.controls[:, 1:])
        """Derivatives by what had slid as each frame began, and by what slides in it, of that frame alone."""
        self.controller_stiffness, self.controller_damping = np.zeros(count), np.zeros(count)
        rows = len(self.rollouts)
        self.by_anchors = np.zeros(self.engine.batch.stiffness.shape)
        self.by_stiffness = np.zeros(self.engine.batch.stiffness.shape)
        """Of frames gone back over since the one as which began the codebook was asked for them."""
        self.held: list[Attachments] = [NOTHING_HELD] * rows
        """Controller springs of each row in the frame gone back over last."""
        self.by_rest_length = [np.zeros(0)] * rows
        """Derivatives by their rest lengths, from that frame on."""
        self.tape: FrameTape | None = None
        self.segment: Segment | None = None
        self.pairs: PairArrays | None = None

    def run(self, seeds: np.ndarray) -> Gradient:
        """Back from the derivatives [K, F, N, 3] by the positions."""
        seeded = np.flatnonzero(seeds.any(axis=(0, 2, 3)))
        end = int(seeded[-1]) if len(seeded) else 0
        bounds = np.linspace(0, end, self.windows + 1).astype(int)
        window = np.arange(len(self.rollouts)) % self.windows
        first, last = bounds[:-1][window], bounds[1:][window]
        positions = np.zeros((len(self.rollouts), self.nodes + self.controllers, 3))
        velocities = np.zeros_like(positions)
        memory = np.zeros((len(self.rollouts), *self.engine.memory))
        for offset in reversed(range(int((last - first).max()))):
            # Shorter windows begin to go back later: until then their frame takes no substeps.
            active = first + offset < last
            frames = np.minimum(first + offset, np.maximum(last - 1, 0))
            positions[active, : self.nodes] += seeds[self.rollouts, frames + 1][active]
            begins = frames == first
            positions, velocities, memory = self._back_over_frame(frames, active, begins, positions, velocities, memory)
            # A row that diverged has no numbers to pass on.
            dead = ~self.running[self.rollouts]
            positions[dead], velocities[dead], memory[dead] = 0.0, 0.0, 0.0
            for row in np.flatnonzero(active & ~dead):
                self._back_over_start(row, int(frames[row]), positions[row])
        starts = np.arange(0, len(self.rollouts), self.windows)
        positions, velocities = positions[starts], velocities[starts]
        positions[:, : self.nodes] += seeds[:, 0]
        self.controls[:, 0] += positions[:, self.nodes :]
        self.control_velocities[:, 0] += velocities[:, self.nodes :]
        return self._gradient(positions[:, : self.nodes], velocities[:, : self.nodes])

    def _back_over_frame(
        self,
        frames: np.ndarray,
        active: np.ndarray,
        begins: np.ndarray,
        positions: np.ndarray,
        velocities: np.ndarray,
        memory: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """From derivatives by the state after a frame of each row to those by the state before it.

        The state are positions and velocities [R, N + C, 3], and what springs remember [R, E, M]. `begins` [R] says
        whose window begins with the frame.
        """
        engine = self.engine
        if engine.codebook is not None:
            asked = engine.codebook.asked[frames]
            self._set_state(asked)
            engine.codebook.set_stiffness(engine.state, engine.parameters, engine.springs, self._attachments(asked))
        self._set_state(frames)
        segment = self._segment(frames, active)
        tape = self._tape(engine.frame_inputs(frames, segment), segment)
        wp.copy(tape.start.positions, engine.state.positions)
        wp.copy(tape.start.velocities, engine.state.velocities)
        if memory.size:
            tape.start.memory.assign(pack(self.memory[frames, self.rollouts]))
        tape.forward()
        tape.clear_derivatives()
        motion = [getattr(engine.controller_arrays, name) for name in MOTION_NAMES]
        grips = [getattr(segment.grips, name) for name in GRIP_NAMES]
        presses = [getattr(segment.presses, name) for name in PRESS_NAMES]
        for array in (*motion, *grips, *presses):
            array.grad.zero_()
        tape.end.positions.grad.assign(pack(positions))
        tape.end.velocities.grad.assign(pack(velocities))
        if memory.size:
            tape.end.memory.grad.assign(pack(memory))
        tape.backward()
        self._collect_controls(frames)
        self._collect_grips(segment)
        rows = len(self.rollouts)
        by_positions, by_velocities = (
            unpack(state.grad.numpy(), rows).astype(np.float64)
            for state in (tape.start.positions, tape.start.velocities)
        )
        if engine.codebook is not None:
            alive = active & self.running[self.rollouts]
            self._back_over_codebook(alive, begins, asked, asked == frames, by_positions, by_velocities)
        return (
            by_positions,
            by_velocities,
            unpack(tape.start.memory.grad.numpy(), rows).astype(np.float64) if memory.size else memory,
        )

    def _set_state(self, frames: np.ndarray) -> None:
        """Where each row was as a frame began."""
        self.engine.state.positions.assign(pack(self.positions[frames, self.rollouts]))
        self.engine.state.velocities.assign(pack(self.velocities[frames, self.rollouts]))

    def _attachments(self, frames: np.ndarray) -> tuple[Attachments, ...]:
        """What is held in a frame of each row."""
        segments = self.forward.segments
        return tuple(segments[frame].attachments[row] for frame, row in zip(frames, self.rollouts, strict=True))

    def _back_over_codebook(
        self,
        alive: np.ndarray,
        begins: np.ndarray,
        asked: np.ndarray,
        is_asked: np.ndarray,
        by_positions: np.ndarray,
        by_velocities: np.ndarray,
    ) -> None:
        """Add what the loss owes to the state that stiffness follows from, in rows whose codebook was asked with it.

        A window that begins between two questions ends there: weights learn of it, the state before it does not.
        """
        springs, rows = self.engine.springs, len(self.rollouts)
        by_stiffness, stiffness = (
            unpack(each.numpy(), rows).astype(np.float64) for each in (springs.stiffness.grad, springs.stiffness)
        )
        springs.stiffness.grad.zero_()
        anchors = self.engine.batch.stiffness
        has = anchors > 0.0
        by_stiffness = np.where(has & alive[:, None], by_stiffness, 0.0)
        self.by_anchors += by_stiffness * stiffness / np.where(has, anchors, 1.0)
        if self.through_codebook is None:
            return
        self.by_stiffness += by_stiffness
        ends = alive & (is_asked | begins)
        if not ends.any():
            return
        there = asked[ends], self.rollouts[ends]
        positions, velocities = (each[there][:, : self.nodes] for each in (self.positions, self.velocities))
        held = held_nodes(self._attachments(asked), self.nodes)[ends]
        found = self.through_codebook(positions, velocities, held, self.by_stiffness[ends])
        self.by_stiffness[ends] = 0.0
        passed = is_asked[ends]
        by_positions[ends & is_asked, : self.nodes] += found[0][passed]
        by_velocities[ends & is_asked, : self.nodes] += found[1][passed]

    def _segment(self, frames: np.ndarray, active: np.ndarray) -> Segment:
        """The segments of each row's frame put together; with the last one's springs, if they are the same."""
        rows = [(self.forward.segments[frame], row) for frame, row in zip(frames, self.rollouts, strict=True)]
        attachments = self._attachments(frames)
        last = self.segment
        if last is None or any(a is not b for a, b in zip(attachments, last.attachments, strict=True)):
            grips, columns = self.engine.grips_of(attachments)
            presses, press_columns = self.engine.presses_of(attachments)
            self.tape = None
        else:
            grips, columns = last.grips, list(last.columns)
            presses, press_columns = last.presses, list(last.press_columns)
        self.segment = Segment(
            attachments=attachments,
            columns=tuple(columns),
            grips=grips,
            press_columns=tuple(press_columns),
            presses=presses,
            rates=np.stack([segment.rates[:, row] for segment, row in rows], axis=1),
            spring_rates=np.array([segment.spring_rates[row] for segment, row in rows]),
            durations=np.array([segment.durations[row] for segment, row in rows]),
            stiffness_rates=np.array([segment.stiffness_rates[row] for segment, row in rows]),
            substeps=np.where(active, [segment.substeps[row] for segment, row in rows], 0),
        )
        return self.segment

    def _tape(self, inputs: FrameInputs, segment: Segment) -> FrameTape:
        """The tape of a frame; the last one serves as long as it would read the same arrays."""
        engine, substeps = self.engine, int(segment.substeps.max())
        if engine.finder is not None and engine.finder.pairs is not self.pairs:
            self.tape, self.pairs = None, engine.finder.pairs
        # Where there are none now, there may be some in the next frame.
        inputs = replace(inputs, pairs=inputs.pairs if self.pairs is None else self.pairs)
        if self.tape is None or self.tape.substeps != substeps:
            self.tape = FrameTape(substeps, engine.groups, self.nodes, self.controllers, engine.memory, engine.device)
            self.tape.record(inputs)
        return self.tape

    def _collect_controls(self, frames: np.ndarray) -> None:
        arrays, rows = self.engine.controller_arrays, len(self.rollouts)
        by = {name: unpack(getattr(arrays, name).grad.numpy(), rows) for name in MOTION_NAMES}
        totals = [
            (self.controls, frames, by["start_positions"]),
            (self.controls, frames + 1, by["end_positions"]),
            (self.control_velocities, frames, by["start_velocities"]),
            (self.control_velocities, frames + 1, by["end_velocities"]),
        ]
        if self.sliding is not None:
            durations = (self.engine.times[frames + 1] - self.engine.times[frames])[:, None, None]
            by_velocity = (by["start_velocities"] + by["end_velocities"]) / durations
            totals += [
                (self.by_slid, frames, by["start_positions"] + by["end_positions"]),
                (self.by_slides, frames, by["end_positions"] + by_velocity),
            ]
        for total, at, values in totals:
            np.add.at(total, (self.rollouts, at), values)

    def _collect_grips(self, segment: Segment) -> None:
        rows = len(self.rollouts)
        stiffness, damping, rest_lengths = (
            unpack(getattr(segment.grips, name).grad.numpy(), rows) for name in GRIP_NAMES
        )
        reaches, firmness, press_damping = (
            unpack(getattr(segment.presses, name).grad.numpy(), rows) for name in PRESS_NAMES
        )
        for row, (held, columns) in enumerate(zip(segment.attachments, segment.columns, strict=True)):
            # Springs that this row lacks have derivatives as well.
            rollout = self.rollouts[row]
            self.controller_stiffness[rollout] += stiffness[row, columns].sum() + FIRMNESS * firmness[row]
            self.controller_damping[rollout] += damping[row, columns].sum() + FIRMNESS * press_damping[row]
            if held is not self.held[row]:
                later = dict(zip(self.held[row].identities(), self.by_rest_length[row], strict=True))
                self.by_rest_length[row] = np.array([later.get(identity, 0.0) for identity in held.identities()])
                self.held[row] = held
            now = np.zeros(len(held.nodes))
            now[held.holds] = rest_lengths[row, columns]
            now[~held.holds] = reaches[row, segment.press_columns[row]]
            self.by_rest_length[row] = self.by_rest_length[row] + now

    def _back_over_start(self, row: int, frame: int, positions: np.ndarray) -> None:
        """Where controller springs begin with this frame, pass on what depends on their rest lengths.

        A rest length is the distance of node and controller point as the contact begins.
        """
        rollout = self.rollouts[row]
        segments = self.forward.segments
        before = segments[frame - 1].attachments[rollout] if frame else NOTHING_HELD
        held = self.held[row]
        if held is before:
            return
        earlier = set(before.identities())
        new = [index for index, identity in enumerate(held.identities()) if identity not in earlier]
        nodes, controllers = held.nodes[new], held.controllers[new]
        offset = self.positions[frame, rollout, nodes] - self.forward.controllers[rollout, frame, controllers]
        length = np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), SHORTEST_LENGTH)
        pull = self.by_rest_length[row][new, None] * offset / length
        np.add.at(positions, nodes, pull)
        np.add.at(self.controls[rollout, frame], controllers, -pull)

    def _gradient(self, positions: np.ndarray, velocities: np.ndarray) -> Gradient:
        engine, running, count = self.engine, self.running, self.forward.batch.count
        velocity_of_position = np.gradient(np.eye(len(engine.times)), engine.times, axis=0)
        controls = self.controls + np.einsum("ft,kfcx->ktcx", velocity_of_position, self.control_velocities)

        def of_rollouts(values: np.ndarray) -> np.ndarray:
            values = values.reshape(count, self.windows, *values.shape[1:]).sum(axis=1)
            values[~running] = 0.0
            return values

        def total(array: wp.array) -> np.ndarray:
            return of_rollouts(unpack(array.grad.numpy(), len(self.rollouts)).astype(np.float64))

        of_springs = {name: total(getattr(engine.springs, name)) for name in SPRING_NAMES}
        if engine.codebook is not None:
            of_springs["stiffness"] = of_rollouts(self.by_anchors)

        # Kernels read masses and their inverses.
        by_masses = (
            total(engine.parameters.masses) - total(engine.parameters.inverse_masses) / self.forward.batch.masses**2
        )
        slides, pulls = self.by_slides, np.zeros_like(self.by_slides)
        if self.sliding is not None:
            slides, pulls = self.sliding.gradient(self.by_slid, self.by_slides), self.sliding.pulls
        return Gradient(
            **of_springs,
            masses=by_masses,
            controller_stiffness=np.where(running, self.controller_stiffness, 0.0),
            controller_damping=np.where(running, self.controller_damping, 0.0),
            parameters={name: total(getattr(engine.parameters, name)) for name in (*PARAMETER_NAMES, "contact_height")},
            effects=total(engine.effects.numbers),
            frames=np.zeros((count, 4, 4)),
            controls=np.where(running[:, None, None, None], controls, 0.0),
            slides=np.where(running[:, None, None, None], slides, 0.0),
            pulls=pulls,
            positions=positions,
            velocities=velocities,
        )
