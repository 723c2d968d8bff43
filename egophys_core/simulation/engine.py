"""A batch on a device, advanced frame by frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from egophys_core.errors import SimulationError
from egophys_core.lanes import Lanes, group_count, pack, unpack
from egophys_core.lanes.state import RUNNING
from egophys_core.simulation.attachments import NOTHING_HELD, Attachments, attach
from egophys_core.simulation.batch import RolloutBatch
from egophys_core.simulation.codebook_arrays import DeviceCodebook
from egophys_core.simulation.collision.collision_pairs import PairFinder
from egophys_core.simulation.collision.self_collision import PairArrays
from egophys_core.simulation.controls import ContactKind
from egophys_core.simulation.device_arrays import (
    FIRMNESS,
    MOTION_NAMES,
    controller_arrays,
    frame_arrays,
    grip_arrays,
    nudging_arrays,
    parameter_arrays,
    press_arrays,
    spring_arrays,
    state_arrays,
)
from egophys_core.simulation.effect_arrays import effect_arrays, effect_terms, memory_count
from egophys_core.simulation.effect_rates import EffectRates
from egophys_core.simulation.engine_kernels import load_kernels
from egophys_core.simulation.extremes import find_extremes
from egophys_core.simulation.frame_advance import frame_advance
from egophys_core.simulation.frames import into_record, into_world_directions
from egophys_core.simulation.host_access import HostAccess
from egophys_core.simulation.integrator import FASTEST
from egophys_core.simulation.sliding_grips import SlidingGrips
from egophys_core.simulation.stability import LONGEST_SUBSTEP, largest_eigenvalues, stable_substeps
from egophys_core.simulation.substep import FrameInputs
from egophys_core.simulation.terms.material_frames import settle_material_frames
from egophys_core.simulation.terms.presses import PressArrays
from egophys_core.simulation.terms.rod_bending import rod_arrays
from egophys_core.simulation.terms.springs import SpringArrays

MOST_SUBSTEPS_PER_SECOND = 500_000
"""A rollout that needs more is refused: the stiffness or damping is out of any physical range."""

FASTEST_HAND = 20.0
"""m/s. A controller faster than this is no hand but a fault of the recording."""

STOPPED = -1
"""In `FrameArrays.divergence`: this rollout diverged in an earlier frame."""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Frames in which the same contacts act and the same substeps are taken."""

    attachments: tuple[Attachments, ...]
    """Per rollout."""
    columns: tuple[np.ndarray, ...]
    """Per rollout, where its holds stand in `grips`."""
    grips: SpringArrays
    press_columns: tuple[np.ndarray, ...]
    """Per rollout, where its presses stand in `presses`."""
    presses: PressArrays
    rates: np.ndarray
    """[2, K] largest stiffness rate 1/s^2 and damping rate 1/s, of springs (their anchors), grips and presses."""
    spring_rates: np.ndarray
    """[K] largest stiffness rate of the object's springs alone, 1/s^2; 0 where nothing changes these."""
    durations: np.ndarray
    """[K] seconds a frame."""
    stiffness_rates: np.ndarray
    """[K] largest stiffness rate with what the codebook and effects add in a frame, 1/s^2."""
    substeps: np.ndarray
    """[K] per frame."""


class Engine:
    """The state of K rollouts at some frame, and what they need to go on."""

    def __init__(
        self,
        batch: RolloutBatch,
        device: str,
        *,
        longest_substep: float = LONGEST_SUBSTEP,
        requires_grad: bool = False,
    ) -> None:
        """Put the batch on the device, at its start; with `requires_grad` what is fitted can be differentiated."""
        self.batch, self.device, self.requires_grad = batch, device, requires_grad
        self.longest_substep = longest_substep
        self.nodes, self.groups = batch.positions.shape[1], group_count(batch.count)
        self.times = batch.controls[0].times
        self.controllers = np.stack([controls.positions for controls in batch.controls]).astype(np.float32)
        self.contact = np.stack([controls.contact for controls in batch.controls]).astype(np.uint8)
        self.controller_velocities = np.gradient(self.controllers.astype(np.float64), self.times, axis=1)
        self.memory = (len(batch.springs) if memory_count(batch) else 0, memory_count(batch))
        """Springs, and how many numbers each of them remembers."""
        self.sliding = None if batch.slides is None else SlidingGrips(batch)
        self.state = state_arrays(
            np.concatenate([batch.positions, self.controllers[:, 0]], axis=1),
            np.concatenate([batch.velocities, self.controller_velocities[:, 0]], axis=1),
            device,
            memory=self.memory,
        )
        self.springs = spring_arrays(batch, device, requires_grad=requires_grad)
        self.parameters = parameter_arrays(batch, device, requires_grad=requires_grad)
        self.rods = rod_arrays(batch.rods, device)
        self.nudging = nudging_arrays(batch, device)
        self.terms = effect_terms(batch)
        load_kernels(self.terms, device)
        self.effects = effect_arrays(batch, device, requires_grad=requires_grad)
        self.effect_rates = EffectRates(batch)
        self.codebook = None if batch.codebook is None else DeviceCodebook(batch, batch.codebook, device)
        self.anchored = self.springs if self.codebook is None else spring_arrays(batch, device)
        """The same springs without what the codebook makes of them."""
        self.controller_arrays = controller_arrays(
            self.groups, self.controllers.shape[2], device, requires_grad=requires_grad
        )
        self.frame_arrays = frame_arrays(batch, device)
        distances = np.array([parameters.collision_distance for parameters in batch.parameters])
        self.finder = PairFinder(batch.rest_positions, distances, device) if distances.any() else None
        self.no_pairs = PairArrays()
        self.advance = frame_advance(self.groups, self.nodes, self.controllers.shape[2], self.memory, device)
        written = {name: getattr(self.controller_arrays, name) for name in MOTION_NAMES}
        written |= {name: getattr(self.frame_arrays, name) for name in ("start", "duration", "substeps", "divergence")}
        if batch.nudging is not None:
            written |= {name: getattr(self.nudging, name) for name in ("accelerations", "drags")}
        self._host = {name: HostAccess(array) for name, array in written.items()}
        self.segments: list[Segment] = []
        """Of each frame advanced so far."""
        self.failures: list[str | None] = [None] * batch.count

    def node_positions(self) -> np.ndarray:
        """[K, N, 3] metres."""
        return unpack(self.state.positions.numpy(), self.batch.count)[:, : self.nodes]

    def node_velocities(self) -> np.ndarray:
        """[K, N, 3] m/s."""
        return unpack(self.state.velocities.numpy(), self.batch.count)[:, : self.nodes]

    def advance_frame(self, frame: int) -> None:
        """From the times of frame to those of frame + 1.

        Raises:
            SimulationError: a rollout would need more than `MOST_SUBSTEPS_PER_SECOND` substeps a second.
        """
        segment = self._segment(frame)
        asks = self.codebook is not None and self.codebook.asked[frame] == frame
        if self.codebook is not None and asks:
            self.codebook.set_stiffness(self.state, self.parameters, self.springs, segment.attachments)
        if self.effect_rates.follows or asks:
            segment = self._with_substeps(segment)
        self.segments.append(segment)
        if self.sliding is not None:
            self.sliding.slide(frame, self.node_positions(), segment.attachments)
        if self.batch.nudging is not None:
            self._nudge(float(self.times[frame]))
        if self.batch.rods is not None:
            wp.launch(
                settle_material_frames, self.groups, inputs=[self.nodes, self.state, self.rods], device=self.device
            )
        frames = np.full(self.batch.count, frame)
        self.advance(self.state, int(segment.substeps.max()), self.frame_inputs(frames, segment))
        self._record_divergence(frame, segment)

    def _segment(self, frame: int) -> Segment:
        """The last one, unless contacts begin or end or the frame lasts longer or shorter."""
        durations = np.full(self.batch.count, self.times[frame + 1] - self.times[frame])
        if not self.segments or (self.contact[:, frame] != self.contact[:, frame - 1]).any():
            return self._new_segment(frame, durations)
        last = self.segments[-1]
        if np.array_equal(durations, last.durations):
            return last
        return self._with_substeps(replace(last, durations=durations))

    def _nudge(self, time: float) -> None:
        """Put the nudging of this frame on the device; a rollout that diverged is left alone."""
        nudging, frames = self.batch.nudging, self.batch.frames
        positions = self.node_positions()
        accelerations, drags = np.zeros(positions.shape), np.zeros(positions.shape[:2])
        running = np.isfinite(positions).all(axis=(1, 2))
        there = positions[running].astype(np.float64)
        if nudging is not None and running.any():
            found, drags[running] = nudging(time, there if frames is None else into_record(there, frames[running]))
            accelerations[running] = found if frames is None else into_world_directions(found, frames[running])
        self._host["accelerations"].write(pack(accelerations))
        self._host["drags"].write(pack(drags))

    def frame_inputs(self, frames: np.ndarray, segment: Segment) -> FrameInputs:
        """What the kernels read in a frame of each rollout, `frames` [K], that begins with the present state."""
        rows = np.arange(self.batch.count)
        values = {
            "start": self.times[frames] - self.times[0],
            "duration": segment.durations,
            "substeps": segment.substeps,
            "start_positions": self.controllers[rows, frames],
            "end_positions": self.controllers[rows, frames + 1],
            "start_velocities": self.controller_velocities[rows, frames],
            "end_velocities": self.controller_velocities[rows, frames + 1],
        }
        if self.sliding is not None:
            slid, slides = self.sliding.before[rows, frames], self.sliding.within[rows, frames]
            values["start_positions"] = values["start_positions"] + slid
            values["end_positions"] = values["end_positions"] + slid + slides
            for name in ("start_velocities", "end_velocities"):
                values[name] = values[name] + slides / segment.durations[:, None, None]
        for name, value in values.items():
            self._host[name].write(pack(value))
        return FrameInputs(
            springs=self.springs,
            grips=segment.grips,
            presses=segment.presses,
            controllers=self.controller_arrays,
            parameters=self.parameters,
            rods=self.rods,
            nudging=self.nudging,
            terms=self.terms,
            effects=self.effects,
            pairs=self._pairs(float(segment.durations.max())),
            frame=self.frame_arrays,
        )

    def _pairs(self, horizon: float) -> PairArrays:
        if self.finder is not None and self.finder.find(self.state.positions, self.state.velocities, horizon):
            return self.finder.pairs
        return self.no_pairs

    def _new_segment(self, frame: int, durations: np.ndarray) -> Segment:
        contact = self.contact[:, frame]
        before = self.contact[:, frame - 1] if self.segments else np.zeros_like(contact)
        attachments = self.segments[-1].attachments if self.segments else (NOTHING_HELD,) * self.batch.count
        positions = self.node_positions()
        # Nobody takes hold of an object that diverged: where it is means nothing.
        running = np.array([failure is None for failure in self.failures])
        begins = np.where((contact == before) | ~running[:, None], ContactKind.NONE, contact)
        updated = tuple(
            attachments[row]
            .of_controllers(contact[row] == before[row])
            .joined(
                attach(
                    positions[row],
                    self.controllers[row, frame],
                    begins[row],
                    radius=self.batch.parameters[row].controller_radius,
                    max_neighbours=self.batch.parameters[row].controller_neighbours,
                    flat=self.batch.flat,
                )
            )
            for row in range(self.batch.count)
        )
        grips, columns = self.grips_of(updated)
        presses, press_columns = self.presses_of(updated)
        of_springs = [
            largest_eigenvalues(self.anchored, grips, self.parameters.masses, self.batch.count, damping=kind)
            for kind in (False, True)
        ]
        of_presses = self._press_rates(updated)
        segment = Segment(
            attachments=updated,
            columns=tuple(columns),
            grips=grips,
            press_columns=tuple(press_columns),
            presses=presses,
            rates=np.stack(of_springs) + of_presses,
            spring_rates=self._spring_rates(),
            durations=durations,
            stiffness_rates=np.zeros(self.batch.count),
            substeps=np.zeros(self.batch.count, int),
        )
        return self._with_substeps(segment)

    def _press_rates(self, attachments: Sequence[Attachments]) -> np.ndarray:
        """[2, K] what presses add to the largest stiffness rate, 1/s^2, and damping rate, 1/s, of each rollout."""
        presses = np.array([(~held.holds).sum() for held in attachments])
        firmness = np.array([(each.controller_stiffness, each.damping) for each in self.batch.parameters]).T
        return np.asarray(FIRMNESS * firmness * (presses / self.batch.masses.min(axis=1)))

    def _spring_rates(self) -> np.ndarray:
        """[K] as `Segment.spring_rates`; the same in all segments."""
        if not self.effect_rates.laws and self.codebook is None:
            return np.zeros(self.batch.count)
        if self.segments:
            return self.segments[-1].spring_rates
        nothing_held, _ = self.grips_of((NOTHING_HELD,) * self.batch.count)
        return largest_eigenvalues(self.anchored, nothing_held, self.parameters.masses, self.batch.count, damping=False)

    def _rates(self, segment: Segment) -> tuple[np.ndarray, np.ndarray]:
        """[K] largest stiffness rates 1/s^2 and [K] damping rates 1/s, with what effects add in the coming frame.

        The largest eigenvalue of a sum is at most the sum of the largest ones, and that of springs which are at most so
        much stiffer than their anchors at most so much larger.
        """
        added = self.effect_rates.at(*self._extremes()) if self.effect_rates.follows else self.effect_rates.at_rest()
        stiffness, damping = segment.rates
        factor = added.factor * (1.0 if self.codebook is None else self.codebook.largest_factors)
        stiffness = stiffness + (factor - 1.0) * segment.spring_rates + added.stiffness
        return stiffness, damping + added.damping

    def _extremes(self) -> tuple[np.ndarray, np.ndarray]:
        """[K] the largest strain of each rollout, and its largest speed, m/s; 0 where it diverged."""
        strains, speeds = (wp.zeros(self.groups, dtype=Lanes, device=self.device) for _ in range(2))
        wp.launch(
            find_extremes,
            self.groups,
            inputs=[self.nodes, self.state, self.springs, strains, speeds],
            device=self.device,
        )
        running = np.array([failure is None for failure in self.failures])
        strain, squared = (unpack(each.numpy(), self.batch.count).astype(np.float64) for each in (strains, speeds))
        return np.where(running, strain, 0.0), np.sqrt(np.where(running, squared, 0.0))

    def grips_of(self, attachments: Sequence[Attachments]) -> tuple[SpringArrays, list[np.ndarray]]:
        """The springs of the holds of all rollouts as arrays, and where each rollout's own stand in them."""
        return grip_arrays(self.batch, attachments, self.device, requires_grad=self.requires_grad)

    def presses_of(self, attachments: Sequence[Attachments]) -> tuple[PressArrays, list[np.ndarray]]:
        """The presses of all rollouts as arrays, and where each rollout's own stand in them."""
        return press_arrays(self.batch, attachments, self.device, requires_grad=self.requires_grad)

    def _with_substeps(self, segment: Segment) -> Segment:
        """The segment with as many as its coming frame needs."""
        stiffness, damping = self._rates(segment)
        substeps = stable_substeps(segment.durations, stiffness, damping, longest_substep=self.longest_substep)
        per_second = substeps / segment.durations
        if per_second.max() > MOST_SUBSTEPS_PER_SECOND:
            row = int(per_second.argmax())
            raise SimulationError(
                f"rollout {row} needs {per_second[row]:.0f} substeps a second, at most "
                f"{MOST_SUBSTEPS_PER_SECOND}: stiffness {self.batch.parameters[row].stiffness:g} N/m or damping "
                f"{self.batch.parameters[row].damping:g} N s/m is too large for nodes of "
                f"{self.batch.masses[row].min():g} kg; lower it or its bound"
            )
        return replace(segment, stiffness_rates=stiffness, substeps=substeps)

    def _record_divergence(self, frame: int, segment: Segment) -> None:
        divergence = self._host["divergence"]
        codes = divergence.read().reshape(-1)[: self.batch.count]
        found = (codes >= 0) & (codes < RUNNING)
        if not found.any():
            return
        for row in np.flatnonzero(found):
            substep, node = divmod(int(codes[row]), self.nodes)
            self.failures[row] = self._cause(row, frame, substep, node, segment)
        everything = divergence.read().copy()
        everything[everything < RUNNING] = STOPPED
        divergence.write(everything)

    def _cause(self, row: int, frame: int, substep: int, node: int, segment: Segment) -> str:
        dt = segment.durations[row] / segment.substeps[row]
        time, phase = self.times[frame] + dt * (substep + 1), dt * np.sqrt(segment.stiffness_rates[row])
        hand_speed = np.linalg.norm(self.controller_velocities[row, frame : frame + 2], axis=2).max(initial=0.0)
        start_speed = np.linalg.norm(self.batch.velocities[row].astype(np.float64), axis=1).max()
        if hand_speed > FASTEST_HAND:
            cause = f"a controller jumps there at {hand_speed:.3g} m/s: check the recording"
        elif start_speed > FASTEST_HAND:
            cause = f"it started with a node at {start_speed:.3g} m/s: check the start velocities"
        else:
            cause = "lower the stiffness, the damping or the size of extra forces"
        return (
            f"node {node} is faster than {FASTEST:g} m/s or not finite on the way to frame {frame + 1} "
            f"(t={time:.3f} s) with omega*dt = {phase:.2f}, stable below 2; {cause}"
        )
