"""What an effect of the library is, and what it sees and does in a rollout.

An effect acts in one or more places: it changes the body before a rollout (`adapt`), changes how the hands move
(`drive`, `clock`), turns the frame in which all of it was recorded (`frame`), or loads the body anew in every frame
(`load`). A load is held over the frame, 1/30 s or less; what depends on velocity is given as a drag, which the substeps
apply to the velocity of the moment.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from egophys_core.effects.effect_values import Values as Values
from egophys_core.effects.traits import Traits


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of an effect."""

    name: str
    unit: str
    """As in SI, "1" for a pure number."""
    low: float
    high: float
    step: float
    """A change that is small but shows in the motion of a towel or toy; scales the sensitivity."""
    null: float | None = None
    """Where the effect vanishes; None for numbers that say where, when or how fast, not how much."""
    logarithmic: bool = False
    """Whether its size is told by its logarithm."""


@dataclass(frozen=True, kw_only=True)
class Body:
    """The nodes and springs of a rollout before it begins."""

    positions: np.ndarray
    """[N, 3] metres, at rest in this rollout's place, world."""
    rest_positions: np.ndarray
    """[N, 3] metres, at rest where the twin was built: what is part of the object is told there."""
    masses: np.ndarray
    """[N] kg."""
    springs: np.ndarray
    """[E, 2] node indices."""
    bending: np.ndarray
    """[E] bool: bending springs of a sheet."""
    stiffness: np.ndarray
    """[E] N/m."""
    damping: np.ndarray
    """[E] N s/m."""
    gravity: float
    """m/s^2, downward."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One rollout at the start of a frame."""

    time: float
    """Seconds since the start of the episode."""
    duration: float
    """Seconds to the next frame."""
    positions: np.ndarray
    """[N, 3] metres, world."""
    velocities: np.ndarray
    """[N, 3] m/s."""
    rest_positions: np.ndarray
    """[N, 3] metres, at rest where the twin was built."""
    masses: np.ndarray
    """[N] kg."""
    springs: np.ndarray
    """[E, 2] node indices."""
    rest_lengths: np.ndarray
    """[E] metres."""
    controllers: np.ndarray
    """[C, 3] metres."""
    controller_velocities: np.ndarray
    """[C, 3] m/s."""
    held: np.ndarray
    """[A, 2] node and controller of each controller spring that holds (not of those that press)."""
    contact_height: float
    """World z at which a node touches the table, metres."""
    gravity: float
    """m/s^2, downward."""

    @property
    def strain(self) -> np.ndarray:
        """[E] extension over rest length."""
        along = self.positions.take(self.springs[:, 1], axis=0)
        along -= self.positions.take(self.springs[:, 0], axis=0)
        return np.asarray(np.sqrt(np.einsum("ij,ij->i", along, along)) / self.rest_lengths - 1.0)

    @property
    def on_table(self) -> np.ndarray:
        """[N] 0..1: how much a node lies on the table; it fades out over `CONTACT_BAND`."""
        return np.clip(1.0 - (self.positions[:, 2] - self.contact_height) / CONTACT_BAND, 0.0, 1.0)


CONTACT_BAND = 0.006
"""Metres above the height of contact at which a node no longer counts as lying on the table."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """What an effect does to a body over one frame; what is None it leaves alone."""

    acceleration: np.ndarray | None = None
    """[N, 3] m/s^2: force over node mass."""
    drag: np.ndarray | None = None
    """[N] 1/s: force over node mass and velocity, against the velocity."""
    stiffness_factor: np.ndarray | None = None
    """[E] times the spring's stiffness."""
    rest_shift: np.ndarray | None = None
    """[E] metres added to the spring's rest length."""
    grip_shift: np.ndarray | None = None
    """[C, 3] metres by which a controller point is away from its recorded place at the end of the frame."""


Action = Callable[[Scene, Any], tuple[Load, Any]]
"""From the scene and what the action remembers, None at first, to its load over the frame and its next memory."""

LoadFunction = Callable[[Values, Scene, Any], tuple[Load, Any]]
"""From parameters, scene and what the effect remembers (None at the start) to the load and what it remembers next."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """A physical or measurement effect that a twin may lack."""

    name: str
    """As the field calls it."""
    summary: str
    """What it is, for someone who reads a report."""
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    traits: Traits
    starts: Callable[["Surroundings"], list[dict[str, float]]]
    """From where to search: all parameters, those that say how much at a small size, the others at places
    and times that cover what is possible."""
    superposition: (
        Callable[["Surroundings", list[dict[str, float]]], tuple[list[dict[str, float]], np.ndarray]] | None
    ) = None
    """For an effect whose load is a sum: its pieces, and how much of each [S, K] is in each of S starts. The pieces
    are simulated in place of the starts, of which there may then be many."""
    load: LoadFunction | None = None
    adapt: Callable[[Values, Body], Body] | None = None
    drive: Callable[[Values, np.ndarray, np.ndarray], np.ndarray] | None = None
    """From values, times [F] and controllers [F, C, 3] to where the hands truly were, [F, C, 3] metres."""
    frame: Callable[[Values], np.ndarray] | None = None
    """From values to the rotation [3, 3] from the world, upright and with a level table, to the frame of the record."""
    clock: Callable[[Values, np.ndarray], np.ndarray] | None = None
    """From values and times [F] to the times [F] at which the record of the hands, and of their contacts, holds."""


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What the starts of a search need to know of the episodes."""

    rest_positions: np.ndarray
    """[N, 3] metres, the object at rest where the twin was built."""
    low: np.ndarray
    """[3] metres, lowest corner of where the object was seen."""
    high: np.ndarray
    """[3] metres, highest corner."""
    contact_begins: float
    """Seconds, the first contact of the episodes."""
    end: float
    """Seconds, the end of the longest episode."""


@dataclass(frozen=True, kw_only=True)
class TwinEffect:
    """An effect with its numbers, as a twin carries it."""

    name: str
    values: dict[str, float]
    """By parameter name, SI units."""
