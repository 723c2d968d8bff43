"""Kind: all that differs between one kind of object and another, as values and plain functions.

A kind is one file of this room and one line of its list (`egophys_core.kinds.KINDS`). It may be modelled from what is
seen all over its surface, from a few markers on it, or from either: `FromSurface` and `FromMarkers` say how.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from egophys_core.effects.effect import Parameter
from egophys_core.effects.traits import Need
from egophys_core.kinds.template import Template
from egophys_core.twin import ObjectModel, SpringGraph, SpringKind

FIST_RADIUS = 0.045
"""Metres around the middle of a fist within which what it holds moves as it does (docs/notes/grips.md)."""

FOOT_M = 0.0025
"""Metres above an object's lowest node up to which nodes are part of its foot."""


class Touch(StrEnum):
    """What hands do with an object."""

    HELD = "held"
    PRESSED = "pressed"


@dataclass(frozen=True, kw_only=True)
class RestShape:
    """Nodes of the object before it is touched."""

    positions: np.ndarray
    """[N, 3] float32, metres, world; surface nodes first."""
    surface: np.ndarray
    """[N] bool."""
    kind: str
    """Name of the kind."""
    spacing: float
    """Median distance of a surface node to its fourth-nearest other one, metres: a grid's spacing, whether
    the points are a grid or strewn at random."""
    lies: bool = True
    """Whether it lies on the table, or hangs in hands."""
    grasp_radius: float = FIST_RADIUS
    """Metres around each point of a hand within which it holds."""
    touches: frozenset[Touch] = frozenset(Touch)
    """What hands did with it in the recordings."""


@dataclass(frozen=True, kw_only=True)
class Searched:
    """One searched number: normalised u in 0..1 is low (high / low)^u or low + u (high - low)."""

    name: str
    low: float
    high: float
    start: float
    logarithmic: bool = False
    shown_by: Touch | None = None
    """What hands must have done for it to show: what they did not is not searched, and stays at its start."""

    def value(self, u: float) -> float:
        """The number at normalised coordinate u."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** u)
        return float(self.low + u * (self.high - self.low))

    @property
    def start_u(self) -> float:
        """Normalised coordinate of the start."""
        if self.logarithmic:
            return float(np.log(self.start / self.low) / np.log(self.high / self.low))
        return (self.start - self.low) / (self.high - self.low)


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """A number of a twin that a diagnosis fits anew, with and without an effect."""

    parameter: Parameter
    """Its name, unit, bounds and step; of the name of one of `PhysicalParameters` if `springs` is None."""
    springs: SpringKind | None = None
    """If given it is the median stiffness of these springs, N/m, and they are scaled together."""


def no_inside(points: np.ndarray, spacing: float, ground: float) -> np.ndarray:
    """[0, 3]: nothing but what is seen."""
    return np.zeros((0, 3))


@dataclass(frozen=True, kw_only=True)
class FromSurface:
    """How a kind is modelled whose surface is seen all over, at rest on a table before hands move it."""

    recognises: Callable[[np.ndarray], bool]
    """Whether points at rest [P, 3], metres, look like one; of the kinds that say so the first of the list is taken."""
    searched: tuple[Searched, ...]
    """The numbers of the coarse fit of one that lies on a table."""
    model: Callable[[RestShape, Mapping[str, float], float], ObjectModel]
    """The model of a shape with searched numbers by name, over a table at a height in metres."""
    searched_hanging: tuple[Searched, ...] | None = None
    """Those of one that hangs; None for the same."""
    inside: Callable[[np.ndarray, float, float], np.ndarray] = no_inside
    """[I, 3] nodes that are not seen, of points [P, 3], their spacing and the table's height, metres."""

    def numbers(self, shape: RestShape) -> tuple[Searched, ...]:
        """The numbers of the coarse fit of a shape."""
        return tuple(
            each for each in self._all_numbers(shape) if each.shown_by is None or each.shown_by in shape.touches
        )

    def candidate(self, shape: RestShape, coordinates: np.ndarray, *, ground_height: float) -> ObjectModel:
        """The model at normalised coordinates [D] in 0..1 of the searched numbers."""
        values = {number.name: number.start for number in self._all_numbers(shape)}
        searched = zip(self.numbers(shape), coordinates, strict=True)
        return self.model(shape, values | {number.name: number.value(u) for number, u in searched}, ground_height)

    def _all_numbers(self, shape: RestShape) -> tuple[Searched, ...]:
        return self.searched if shape.lies or self.searched_hanging is None else self.searched_hanging


@dataclass(frozen=True, kw_only=True)
class SeenMarkers:
    """What a record of a few markers on an object in clamps shows; metres, seconds, world."""

    name: str
    """Of the episode."""
    clamps: tuple[np.ndarray, ...]
    """Indices of the held points of each clamp."""
    held: np.ndarray
    """[C, 3] float64, held points in the first frame of the record."""
    tracks: np.ndarray
    """[P, 3] float64, markers then."""
    onset: np.ndarray
    """[P, 3] float64, markers where rollouts begin."""
    hands: np.ndarray
    """[T, C, 3] float64, held points from there on."""
    smoothed: np.ndarray
    """[T, C, 3] float64, the same without what hands do not do so fast."""
    places: np.ndarray
    """[C + P, 3] held points and markers where rollouts begin, by what they do soon after."""
    velocities: np.ndarray
    """[C + P, 3] m/s, of these."""


@dataclass(frozen=True, kw_only=True)
class MarkerBody:
    """An object as markers show it, with a template or without."""

    kind: str
    """Name of the kind."""
    graph: SpringGraph
    grasp: np.ndarray
    """[C + P + G, 3] metres: the episode's held points, then its markers in frame 0, then the clamped nodes. Of what is
    a line they lie on its axis."""
    spacing: float
    """Metres between nodes."""
    volume: float
    """m^3."""
    length: float
    """Metres that are free."""
    is_size_known: bool
    """Whether its volume is more than a guess, and its mass with it."""
    notes: tuple[str, ...]
    """What was assumed, in words."""


@dataclass(frozen=True, kw_only=True)
class PlacedMarkers:
    """A twin in a record of markers."""

    start: np.ndarray
    """[N, 3] float64 metres, its nodes where rollouts begin."""
    velocities: np.ndarray
    """[N, 3] float64 m/s."""
    bound: np.ndarray
    """[P] the node that each marker is."""
    clamped: np.ndarray
    """[G, 3] float64 metres, the clamped nodes there."""
    hands: np.ndarray
    """[T, C, 3] metres, the held points that carry these."""
    still: float | None
    """Metres within which held points count as still; None for as much as markers slip."""
    payload: np.ndarray
    """[N] kg that nodes carry beside their own masses."""


@dataclass(frozen=True, kw_only=True)
class Unknowns:
    """Numbers [D] that are searched: logarithms of stiffness and of damping, a drag (1/s), and what else there is."""

    steps: np.ndarray
    """[D] first steps of a refinement."""
    static_deflection: np.ndarray
    """[K, D] from where to look for the numbers that the static deflection tells."""
    low: np.ndarray
    """[D] least numbers."""
    ring_down: np.ndarray
    """[D] first guess of what the ring-down tells; NaN where the static deflection tells it."""
    model: Callable[[np.ndarray], tuple[MarkerBody, ObjectModel]]
    """From numbers [D] to the body, placed as they say, and its model."""
    later: np.ndarray | None = None
    """[D] bool, which numbers join once the others are refined; None for none of them."""
    prior: np.ndarray | None = None
    """[R, D] whose products with numbers are residuals, too, in errors of the fit without the later ones."""

    def about(self, numbers: np.ndarray, stiffer: np.ndarray) -> np.ndarray:
        """[K, D] first guesses for the ring-down, of stiffnesses [K] times that of some numbers [D]."""
        around = np.tile(np.where(np.isnan(self.ring_down), numbers, self.ring_down), (len(stiffer), 1))
        around[:, 0] += np.log(stiffer)
        return around


@dataclass(frozen=True, kw_only=True)
class FromMarkers:
    """How a kind is modelled that is held in clamps and seen at a few markers."""

    body: Callable[[SeenMarkers, Template | None], MarkerBody | None]
    """What markers show; None if this is no object of the kind. Of the kinds that know it the first of the list is
    taken."""
    unknowns: Callable[[MarkerBody, int, float], Unknowns]
    """What is unknown of a body with so many recorded points, of a density in kg/m^3."""
    place: Callable[[ObjectModel, np.ndarray, SeenMarkers, float], PlacedMarkers | None]
    """A model with the grasp of its twin in a record, with a load in N at its free end; None if these are not the
    markers that the twin was built from."""
    starts_as_seen: bool = False
    """Whether it begins along what is seen whatever its numbers are."""


def equal_masses(graph: SpringGraph, total: float) -> np.ndarray:
    """[N] float32 kg: the total mass in equal parts."""
    nodes = len(graph.positions)
    return np.full(nodes, total / nodes, np.float32)


def height_of_foot(positions: np.ndarray) -> float:
    """The mean height of the foot; the lowest node of all would only be the one with the most noise."""
    heights = positions[:, 2].astype(np.float64)
    return float(heights[heights <= heights.min() + FOOT_M].mean())


def any_graph(graph: SpringGraph) -> None:
    """Whatever is linked may be."""


def no_models(model: ObjectModel) -> list[ObjectModel]:
    """None but the model itself."""
    return []


def no_variants(model: ObjectModel) -> list[list[ObjectModel]]:
    """No graph but that of the model."""
    return []


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of object."""

    name: str
    """As twin files, options and messages say it."""
    fitted: Callable[[ObjectModel], tuple[FittedParameter, ...]]
    """The numbers that a diagnosis fits anew."""
    faces: Callable[[SpringGraph], np.ndarray]
    """[F, 3] int32: triangles of nodes that cover its surface, to draw it."""
    across: Callable[[np.ndarray], np.ndarray] | None = None
    """From nodes at rest [N, 3], metres, to the four across each of them, [N, 4] int32: its normal is (x_1 - x_0) x
    (x_3 - x_2). None for what is not thin."""
    from_surface: FromSurface | None = None
    from_markers: FromMarkers | None = None
    node_masses: Callable[[SpringGraph, float], np.ndarray] = equal_masses
    """[N] float32 kg, of a total mass in kg."""
    resting_height: Callable[[np.ndarray], float] = height_of_foot
    """z at which one that lies on the table, nodes [N, 3] in metres, touches it."""
    require_graph: Callable[[SpringGraph], None] = any_graph
    """Raises TwinError for a graph that is none of this kind."""
    lies_flat: bool = False
    """Whether all of it touches a table that it lies on: then it tells whether that is level, and fingers that close
    on it take what lies under them."""
    is_line: bool = False
    """Whether it is the nodes of its centre line one after the other, and bends as a line does, not by springs. One
    may swing out of step with its twin, and then slopes tell nothing."""
    static_deflection_is_evidence: bool = True
    """Whether another static deflection than its twin's says that a force acts: how firmly a solid is gripped, how
    stiff it is and how much it weighs are one thing there."""
    cannot_tell: frozenset[Need] = frozenset()
    """What effects need that it has not, and so tells nothing of them."""
    otherwise_at_rest: Callable[[ObjectModel], list[ObjectModel]] = no_models
    """The model as it may be better known than as it was fitted, to be tried beside it."""
    variants: Callable[[ObjectModel], list[list[ObjectModel]]] = no_variants
    """The object with graphs and grasps of other sizes, to be tried beside it: per graph and grasp some models of plain
    parameters."""
