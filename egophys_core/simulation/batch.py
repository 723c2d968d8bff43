"""RolloutBatch: everything K rollouts need, with graphs and parameters of their own."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from egophys_core.effects.effect import Effect
from egophys_core.errors import SimulationError
from egophys_core.simulation.controls import Controls
from egophys_core.twin import Codebook, PhysicalParameters

Nudging = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From seconds since the start of an episode and nodes [K, N, 3], metres, in the frames of their records: accelerations
[K, N, 3], m/s^2, there, and drags [N], 1/s. What it says of one rollout must not depend on the others."""


Slide = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""From times at which frames begin and end [F], seconds, and what pulls on hands as they begin [F, C, 3], over the
object's weight, to how far what is held slides through them [F, C, 3], metres (`Effect.slide` with its values)."""


@dataclass(frozen=True, kw_only=True)
class BatchEffect:
    """An effect that acts in every substep, with its numbers in each rollout of a batch."""

    effect: Effect
    numbers: np.ndarray
    """[K, P] float32, what its function reads; zeros where a rollout lacks it."""
    present: np.ndarray
    """[K] bool, which rollouts have it."""

    def rows(self, rows: np.ndarray) -> "BatchEffect":
        """The effect in some rollouts, in this order."""
        return replace(self, numbers=self.numbers[rows], present=self.present[rows])


LONGEST_HELD = 0.07
"""Seconds for which stiffness is held at most: two frames at 30 Hz. `benchmarks/prior/rate.py` has what that costs."""


@dataclass(frozen=True, kw_only=True)
class BatchCodebook:
    """The codebook that gives springs of a batch their stiffness, frame by frame."""

    codebook: Codebook
    features: np.ndarray
    """[K, E, S] float32, static features (`twin.spring_features`); zeros where a rollout lacks the spring."""
    used: np.ndarray
    """[K] bool, which rollouts have it; the stiffness of the others is fixed."""
    longest_held: float = LONGEST_HELD
    """Seconds for which an answer serves at most; always for a whole frame of the controls."""

    def rows(self, rows: np.ndarray) -> "BatchCodebook":
        """The codebook in some rollouts, in this order."""
        return replace(self, features=self.features[rows], used=self.used[rows])


@dataclass(frozen=True, kw_only=True)
class Rods:
    """What K rods resist besides being stretched (`terms.rod_bending`)."""

    rigidity: np.ndarray
    """[K] EI, N m^2."""
    viscosity: np.ndarray
    """[K] N m^2 s: EI times the retardation time."""
    torsion: np.ndarray
    """[K] GJ, N m^2."""
    far_clamps: np.ndarray
    """[K] bool: whether a clamp holds the last node."""
    curvatures: np.ndarray
    """[K, N, 3] 1/m, the intrinsic curvature at the nodes on the straight rod."""
    far_rolls: np.ndarray
    """[K] radians by which the far clamp holds the rod turned about its line."""
    axes: np.ndarray
    """[K, 3] direction of the straight rod, of length 1."""
    lengths: np.ndarray
    """[K, N - 1] metres of the pieces between nodes."""
    rates: np.ndarray
    """[K, 2] largest omega^2, 1/s^2, and damping rate, 1/s, of what it adds."""

    def rows(self, rows: np.ndarray) -> "Rods":
        """Some rods, in this order."""
        return Rods(**{name: values[rows] for name, values in vars(self).items()})


@dataclass(frozen=True, kw_only=True)
class RolloutBatch:
    """K rollouts of objects with equally many nodes, advanced together.

    Rollouts may differ in springs: `springs` is the union, and a stiffness and a damping of 0 say that one lacks it.
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
    effects: tuple[BatchEffect, ...] = ()
    """What acts in every substep beyond the base simulator, no effect twice."""
    slides: tuple[tuple[Slide, ...], ...] | None = None
    """Per rollout the laws by which grips slip; None where none of them does."""
    across: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), np.int32))
    """[N, 4] int32: nodes across each node of thin objects, whose normal is (x_1 - x_0) x (x_3 - x_2) there; [0, 4]
    where no rollout has added mass."""
    codebook: BatchCodebook | None = None
    """What multiplies the stiffness of springs, if anything does."""
    rods: Rods | None = None
    """What resists bending, if the objects are rods."""
    nudging: Nudging | None = None
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
        for each in self.effects:
            if each.numbers.ndim != 2 or len(each.numbers) != count:
                raise SimulationError(
                    f"the numbers of {each.effect.name} must be [{count}, P], got {each.numbers.shape}"
                )
        names = [each.effect.name for each in self.effects]
        if len(set(names)) < len(names):
            raise SimulationError(f"an effect can act once in a batch, got {', '.join(names)}")
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

    def part(self, rows: np.ndarray) -> "RolloutBatch":
        """Some rollouts as a batch of their own, without the springs that none of them has."""
        part = self.rows(rows)
        present = ((part.stiffness > 0) | (part.damping > 0)).any(axis=0)
        learned = part.codebook
        return replace(
            part,
            codebook=None if learned is None else replace(learned, features=learned.features[:, present]),
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
            slides=None if self.slides is None else tuple(self.slides[row] for row in rows),
            codebook=None if self.codebook is None else self.codebook.rows(rows),
            rods=None if self.rods is None else self.rods.rows(rows),
            frames=None if self.frames is None else self.frames[rows],
        )
