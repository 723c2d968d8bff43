"""What an effect of the library is, and how it acts in a rollout.

An effect acts in one or more places: it adds forces to nodes (`node_force`) or changes the law of springs
(`spring_law`), both in every substep, as functions of Warp; it changes the body before a rollout (`adapt`), how the
hands moved (`drive`, `clock`), what slides through them (`slide`), or the frame in which all of it was recorded
(`frame`), as functions of NumPy.
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
    begins: float
    """Seconds since the start of the episode at which the rollout begins."""
    added_mass: float = 0.0
    """Of the air that a thin object carries along its normal, over its own mass."""


Numbers = Callable[[Values, Body], np.ndarray]
"""From an effect's parameters and the body of a rollout to [P] what its function of Warp reads in every substep. A
rollout that lacks the effect has zeros there, with which the function must change nothing, to the bit."""


@dataclass(frozen=True, kw_only=True)
class NodeForce:
    """Forces on nodes, in every substep.

    `function` is a `wp.func` that adds newtons to the forces on a range of nodes, as the simulator's own terms do::

        add(group, first, last, column, time, dt, state, parameters, numbers, forces)

    with `column` the place of the first of its numbers in `numbers` [G, P], `time` seconds since the start of the
    rollout and `dt` seconds of the substep, 0 for a rollout that has done all of its substeps (all `Lanes`). It must
    not read what it writes, nor use a sum over a loop but to return it, so that it can be differentiated.
    """

    function: Any
    numbers: Numbers
    stiffness_rate: Callable[[np.ndarray], np.ndarray] | None = None
    """From numbers [K, P] to a bound of what it adds to omega^2, 1/s^2 [K]; None where that is no matter."""
    damping_rate: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    """From numbers [K, P] and the largest speed of each rollout's nodes, m/s [K], to a bound of damping rates, 1/s."""


@dataclass(frozen=True, kw_only=True)
class SpringLaw:
    """Another force law of springs than Hooke's, in every substep.

    `function` is a `wp.func` of one spring in `LANES` rollouts, and of nothing but its arguments::

        factor, shift, first, second = law(strain, first, second, dt, begun, a, b, c, d)

    It returns the factor on the spring's stiffness; by how much its rest length grows, over the rest length; and
    what it remembers next of up to two numbers a spring, 0 at the start. `dt` is the duration of the substep, `begun`
    0 in the first substep of a rollout and 1 then, a to d are the law's numbers (all `Lanes`). What it remembers
    should follow the strain after the force of that strain: then it does not delay the force, and takes energy only.
    """

    function: Any
    numbers: Numbers
    """At most four."""
    memories: int = 0
    """How many numbers of a spring it remembers."""
    stiffening: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """From numbers [K, P] and each rollout's largest strain [K] to the largest slope of its force, over Hooke's."""
    follows_strain: bool = False
    """Whether `stiffening` depends on the strain, which is then looked up in every frame."""


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
    node_force: NodeForce | None = None
    spring_law: SpringLaw | None = None
    adapt: Callable[[Values, Body], Body] | None = None
    drive: Callable[[Values, np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None = None
    """From values, times [F], controllers [F, C, 3] and whether they hold [F, C] to where the hands truly were,
    [F, C, 3] metres."""
    slide: Callable[[Values, np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None = None
    """From values, times [F] at which frames begin and [F] at which they end, and what pulls on each hand as they begin
    [F, C, 3], over the object's weight, to how far what is held slides through it in them, [F, C, 3] metres."""
    frame: Callable[[Values], np.ndarray] | None = None
    """From values to the rotation [3, 3] from the world, upright and with a level table, to the frame of the record."""
    plumb: Callable[[Values], np.ndarray] | None = None
    """From values to the direction [3] in which a plumb line points in the record, a unit vector."""
    falls: Callable[[Values], np.ndarray] | None = None
    """From values to how an object falls that nobody holds, [5]: the acceleration of what is slow and carries nothing,
    m/s^2; the deceleration by air over the square of its speed, 1/m; the air that something thin carries along its
    normals, over its mass."""
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
