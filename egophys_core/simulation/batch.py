"""RolloutBatch: everything K rollouts need, with graphs and parameters of their own."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.effects.effect import Action
from egophys_core.errors import SimulationError
from egophys_core.simulation.controls import Controls
from egophys_core.simulation.terms.force_effect import ForceEffect
from egophys_core.twin import PhysicalParameters

Pull = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From seconds since the start of an episode and nodes [K, N, 3], metres, in the frames of their records: accelerations
[K, N, 3], m/s^2, there, and drags [N], 1/s."""


@dataclass(frozen=True, kw_only=True)
class RolloutBatch:
    """K rollouts of objects with equally many nodes, advanced together.

    Rollouts may differ in springs: `springs` is the union, and a stiffness of 0 says that a rollout lacks one.
    """

    springs: np.ndarray
    """[E, 2] int32, in order of their first node."""
    stiffness: np.ndarray
    """[K, E] float32, N/m; 0 where absent."""
    damping: np.ndarray
    """[K, E] float32, N s/m; 0 where absent."""
    rest_lengths: np.ndarray
    """[K, E] float32, metres; any positive number where absent."""
    longest_extensions: np.ndarray
    """[K, E] float32, metres: beyond it a spring pulls no harder; `UNLIMITED` for springs that never soften."""
    masses: np.ndarray
    """[K, N] float32, kg."""
    positions: np.ndarray
    """[K, N, 3] float32, start, metres, world."""
    velocities: np.ndarray
    """[K, N, 3] float32, start, m/s."""
    rest_positions: np.ndarray
    """[N, 3] float32, metres: the object at rest; nodes that are near there do not collide with each other."""
    parameters: tuple[PhysicalParameters, ...]
    """K of them."""
    controls: tuple[Controls, ...]
    """K of them, with the same times and number of controller points."""
    flat: bool
    """Whether controller springs use the flat object's fallback."""
    ground_height: float
    """World z of the table, metres."""
    effects: tuple[ForceEffect, ...] = ()
    """Forces beyond the base simulator's."""
    actions: tuple[tuple[Action, ...], ...] = ()
    """K tuples of what decides on loads frame by frame (`loads.with_actions`), or none at all."""
    pull: Pull | None = None
    """What draws the nodes of all rollouts alike."""
    frames: np.ndarray | None = None
    """[K, 4, 4] frames in which results are given (`simulation.frames`); None where all are the world."""

    def __post_init__(self) -> None:
        count, springs = self.count, len(self.springs)
        nodes = self.positions.shape[1] if self.positions.ndim == 3 else -1
        for label, array, shape in (
            ("springs", self.springs, (springs, 2)),
            ("stiffness", self.stiffness, (count, springs)),
            ("damping", self.damping, (count, springs)),
            ("rest_lengths", self.rest_lengths, (count, springs)),
            ("longest_extensions", self.longest_extensions, (count, springs)),
            ("masses", self.masses, (count, nodes)),
            ("positions", self.positions, (count, nodes, 3)),
            ("velocities", self.velocities, (count, nodes, 3)),
            ("rest_positions", self.rest_positions, (nodes, 3)),
            *(() if self.frames is None else (("frames", self.frames, (count, 4, 4)),)),
        ):
            if array.shape != shape:
                raise SimulationError(f"batch of {count} rollouts: {label} must be {shape}, got {array.shape}")
        if (np.diff(self.springs[:, 0]) < 0).any():
            raise SimulationError("batch: springs must be in order of their first node")
        for effect in self.effects:
            if effect.numbers.ndim != 2 or len(effect.numbers) != count:
                raise SimulationError(f"an effect's numbers must be [{count}, P], got {effect.numbers.shape}")
        if count == 0 or len(self.controls) != count:
            raise SimulationError(f"batch needs one control sequence per rollout: {count} and {len(self.controls)}")
        first = self.controls[0]
        for index, controls in enumerate(self.controls):
            if controls.positions.shape != first.positions.shape or not np.array_equal(controls.times, first.times):
                raise SimulationError(f"batch: controls of rollout {index} differ from rollout 0 in times or points")
        if not (np.isfinite(self.positions).all() and np.isfinite(self.velocities).all()):
            raise SimulationError("batch: start positions and velocities must be finite")

    @property
    def count(self) -> int:
        """Number of rollouts K."""
        return len(self.parameters)

    @property
    def effect_rates(self) -> np.ndarray:
        """[K, 2] bounds of what effects add to omega^2, 1/s^2, and to damping rates, 1/s."""
        return sum((effect.rates for effect in self.effects if effect.rates is not None), np.zeros((self.count, 2)))

    def part(self, rows: np.ndarray) -> "RolloutBatch":
        """Some rollouts as a batch of their own, without the springs that none of them has."""
        part = self.rows(rows)
        present = (part.stiffness > 0).any(axis=0)
        return replace(
            part,
            springs=part.springs[present],
            stiffness=part.stiffness[:, present],
            damping=part.damping[:, present],
            rest_lengths=part.rest_lengths[:, present],
            longest_extensions=part.longest_extensions[:, present],
        )

    def rows(self, rows: np.ndarray) -> "RolloutBatch":
        """Some rollouts, in this order, as often as they are named."""
        return replace(
            self,
            stiffness=self.stiffness[rows],
            damping=self.damping[rows],
            rest_lengths=self.rest_lengths[rows],
            longest_extensions=self.longest_extensions[rows],
            masses=self.masses[rows],
            positions=self.positions[rows],
            velocities=self.velocities[rows],
            parameters=tuple(self.parameters[row] for row in rows),
            controls=tuple(self.controls[row] for row in rows),
            effects=tuple(effect.rows(rows) for effect in self.effects),
            actions=tuple(self.actions[row] for row in rows) if self.actions else (),
            frames=None if self.frames is None else self.frames[rows],
        )
