"""Rods: slender objects, as a cable or a rope, which hardly stretch and resist bending.

The nodes are those of the centre line one after the other, with a spring from each to the next; it resists bending as
a line does, not by springs. It is straight, or of one curvature all along, when nothing acts on it, and begins along
the curve through held points and markers.
"""

from dataclasses import replace
from itertools import product
from typing import TypeVar

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.effects.traits import Need
from egophys_core.errors import TwinError
from egophys_core.kinds.clamped import OVERDAMPED, SOME_DRAG, clamped_parameters
from egophys_core.kinds.kind import FittedParameter, FromMarkers, Kind, MarkerBody, PlacedMarkers, SeenMarkers, Unknowns
from egophys_core.kinds.rod_curve import PIECES, axial_stiffness, bend_to, find_chain, longest_retardation, rod_nodes
from egophys_core.kinds.spring_body import fitted
from egophys_core.kinds.template import Template
from egophys_core.twin import GRAVITY, ObjectModel, SpringGraph, SpringKind, chain
from egophys_core.twin.parameters import INTRINSIC_CURVATURE

FloatOrArray = TypeVar("FloatOrArray", float, np.ndarray)

NAME = "rod"

SLENDER = 12.0
"""Length over width from which a template is a rod's, if its markers lie one after the other."""

NODES_OF_A_CLAMP = 2
"""Which a clamp holds (`rod_curve.rod_nodes`)."""

CROSS_SECTION_M2 = 1e-4
"""m^2, across a rod that no template describes: whatever it is, the rod moves alike."""

OWN_MARKERS = 0.01
"""Metres within which nodes of a twin lie where the markers were that it was built from."""

BENDING_LENGTHS = np.geomspace(0.02, 0.6, 24)
"""(EI / weight per length)^(1/3) over a rod's length, from a chain to a bar: where static deflection is looked at."""

DRAGS = (0.0, SOME_DRAG, 3.0, OVERDAMPED)
"""1/s, at which a rod's static deflection is looked at: hands move it, and overdamped it would follow them otherwise.
With 1 and 20 alone a cable that met a drag was taken for one 10 times as stiff, and one of early hands for 65 times."""

DAMPING_RATIO = 0.02
"""First guess of how a rod's first mode between two clamps is damped."""

CURVATURE_STEP = 0.1
"""Intrinsic curvature times the length of a rod: first step of a fit."""

KNOTS, UNEVEN_STEP = 8, 0.3
"""Places along a rod between which its intrinsic curvature varies, and the first step there, times its length."""

PRIOR = 0.015
"""Errors of the fit with an even intrinsic curvature that a curvature of 1 over the rod's length costs at a knot: about
one over the root of what markers tell apart, over curvatures of 4."""

ROLL_STEP = 0.1
"""Radians, of how the far clamp is turned: first step of a fit."""

EVEN = 6
"""Numbers of a rod before those of the knots."""

DIAGNOSED_CURVATURE_STEP = 0.2
"""The same: step of a diagnosis."""

FIRST_MODE = 22.4
"""Rate in rad/s of that mode, of a rod of 1 m and 1 m^4/s^2 (Rao, Mechanical Vibrations, sec. 8.5)."""


def rod_body(seen: SeenMarkers, template: Template | None) -> MarkerBody | None:
    """A rod, straight from where it is first free on, with all that was recorded on its axis."""
    held, tracks = seen.held, seen.tracks
    slender = template is None or template.length >= SLENDER * template.size[1:].max()
    along = find_chain(held, list(seen.clamps), tracks) if slender else None
    if along is None:
        return None
    length = along.length if along.has_far_clamp or template is None else max(along.length, template.length)
    arc_lengths, clamped = rod_nodes(along, len(held), length)
    begin = held[int(np.abs(along.arc_lengths[: len(held)]).argmin())]
    axis = tracks[-1] - held[0]
    axis /= np.linalg.norm(axis)
    nodes = begin + arc_lengths[:, None] * axis
    cross_section = CROSS_SECTION_M2 if template is None else float(np.prod(template.size[1:]))
    return MarkerBody(
        kind=NAME,
        graph=SpringGraph(
            positions=nodes.astype(np.float32),
            springs=chain(len(nodes)),
            kinds=np.full(len(nodes) - 1, SpringKind.STRUCTURAL, np.uint8),
            rest_lengths=np.diff(arc_lengths).astype(np.float32),
            surface=np.ones(len(nodes), bool),
        ),
        grasp=np.concatenate([begin + along.arc_lengths[:, None] * axis, nodes[clamped]]).astype(np.float32),
        spacing=length / PIECES,
        volume=cross_section * float(np.ptp(arc_lengths)),
        length=length,
        is_size_known=template is not None,
        notes=(
            f"a rod: {1000 * length:.1f} mm of it are free, along the curve through held points and markers",
            "it is alike all along",
        ),
    )


def unknowns(body: MarkerBody, known: int, density: float) -> Unknowns:
    """Flexural rigidity over mass per length, m^4/s^2, and damping ratio of the first mode between two clamps, a drag,
    the intrinsic curvature, 1/m to its level left and up, and later on how the far clamp is turned about the rod's
    line, radians, and how the intrinsic curvature varies along the rod: what it is more at each of `KNOTS`, between
    which it is linear.

    How a rod points is told by the curve that it is seen on. If hands move it, it swings whatever its drag is.
    """
    rigidities = np.log(rigidity_of(BENDING_LENGTHS * body.length))
    along = hat_functions(body)

    def model(numbers: np.ndarray) -> tuple[MarkerBody, ObjectModel]:
        rigidity, ratio = (float(number) for number in np.exp(numbers[:2]))
        time = retardation_of(rigidity, body.length, ratio)
        drag, level, up, far_roll = (float(number) for number in numbers[2:EVEN])
        rod = rod_model(body, density=density, rigidity=rigidity, retardation_time=time, drag=drag)
        even = replace(rod.parameters, intrinsic_curvature_level=level, intrinsic_curvature_up=up, far_roll=far_roll)
        uneven = (along @ numbers[EVEN:].reshape(KNOTS, 2)).astype(np.float32)
        if not uneven.any():
            return body, replace(rod, parameters=even)
        most = float(np.linalg.norm(uneven + [level, up], axis=1).max())
        bent = f"its intrinsic curvature varies along it, up to {most:.1f} 1/m; it is alike otherwise"
        return replace(body, notes=(body.notes[0], bent)), replace(rod, parameters=even, intrinsic_curvature=uneven)

    count = EVEN + 2 * KNOTS
    even_steps, knot_steps = [CURVATURE_STEP / body.length] * 2, [UNEVEN_STEP / body.length] * (2 * KNOTS)
    start = [0.0] * (count - 3)
    return Unknowns(
        steps=np.array([0.1, 0.7, 0.3, *even_steps, ROLL_STEP, *knot_steps]),
        low=np.where(np.arange(count) == 2, 0.0, -np.inf),
        static_deflection=np.array(
            [[each, np.log(DAMPING_RATIO), drag, *start] for drag, each in product(DRAGS, rigidities)]
        ),
        ring_down=np.full(count, np.nan),
        model=model,
        later=np.arange(count) >= EVEN - 1,
        prior=_smoothness(body.length),
    )


def hat_functions(body: MarkerBody) -> np.ndarray:
    """[N, KNOTS] the share of each knot, evenly along the free length, in what is linear between them, at the nodes."""
    lengths = body.graph.rest_lengths.astype(np.float64)
    # The first piece is the near clamp's.
    at = (np.concatenate([[0.0], np.cumsum(lengths)]) - lengths[0]) / body.length
    return np.maximum(0.0, 1.0 - np.abs(np.clip(at, 0.0, 1.0)[:, None] * (KNOTS - 1) - np.arange(KNOTS)))


def _smoothness(length: float) -> np.ndarray:
    """[R, D] what says that a rod's intrinsic curvature is hardly more at a knot, and like the next one's."""
    size = np.eye(2 * KNOTS)
    rows = PRIOR * length * np.concatenate([size, size[2:] - size[:-2]])
    return np.pad(rows, ((0, 0), (EVEN, 0)))


def rigidity_of(bending_length: FloatOrArray) -> FloatOrArray:
    """Flexural rigidity over mass per length, m^4/s^2, of a rod that bends under its weight over a length in metres."""
    return GRAVITY * bending_length**3


def retardation_of(rigidity: float, length: float, ratio: float) -> float:
    """Seconds, the retardation time at which a rod's first mode between two clamps has a damping ratio.

    Args:
        rigidity: flexural rigidity over mass per length, m^4/s^2.
        length: metres.
    """
    return 2.0 * ratio / (FIRST_MODE * np.sqrt(rigidity) / length**2)


def rod_model(
    body: MarkerBody, *, density: float, rigidity: float, retardation_time: float, drag: float
) -> ObjectModel:
    """The model of a rod with a flexural rigidity over mass per length, m^4/s^2, and a drag, 1/s.

    Args:
        retardation_time: seconds, taken to be as long as can be afforded at most.
    """
    lengths = body.graph.rest_lengths.astype(np.float64)
    per_length = density * body.volume / lengths.sum()
    axial = axial_stiffness(per_length, body.length)
    model = ObjectModel(
        kind=NAME,
        graph=body.graph,
        parameters=clamped_parameters(body, density=density, stiffness=axial / body.spacing, damping=0.0, drag=drag),
        stiffness=(axial / lengths).astype(np.float32),
    )
    return with_bending(model, rigidity=rigidity, retardation_time=retardation_time)


def with_bending(model: ObjectModel, *, rigidity: float, retardation_time: float) -> ObjectModel:
    """A rod that bends otherwise.

    Args:
        rigidity: flexural rigidity over mass per length, m^4/s^2.
        retardation_time: seconds, taken to be as long as can be afforded at most.
    """
    lengths = model.graph.rest_lengths.astype(np.float64)
    flexural = rigidity * model.parameters.total_mass / lengths.sum()
    masses = masses_along(model.graph, model.parameters.total_mass)
    time = min(retardation_time, longest_retardation(flexural, lengths, masses))
    return replace(model, parameters=replace(model.parameters, flexural_rigidity=flexural, retardation_time=time))


def place(model: ObjectModel, grasp: np.ndarray, seen: SeenMarkers, load: float) -> PlacedMarkers | None:
    """A rod in a record: it begins along the curve through held points and markers, as fast as these are."""
    count, known = len(seen.held), len(seen.held) + len(seen.tracks)
    nodes = model.graph.positions.astype(np.float64)
    far_clamp = np.array_equal(grasp[-1], model.graph.positions[-1])
    if len(grasp) != known + NODES_OF_A_CLAMP * (1 + far_clamp):
        return None
    bound = np.asarray(cKDTree(model.graph.positions).query(grasp[count:known])[1])
    if not np.allclose(nodes[bound], grasp[count:known], atol=OWN_MARKERS):
        return None
    recorded, clamped = grasp[:known].astype(np.float64), grasp[known:].astype(np.float64)
    # What is bent along a line passes every small rotation of a clamp on.
    bend = bend_to(recorded, np.concatenate([seen.smoothed[0], seen.places[count:]]), seen.velocities)
    return PlacedMarkers(
        start=bend.place(nodes),
        velocities=bend.velocities(nodes),
        bound=bound,
        clamped=bend.place(clamped),
        hands=seen.smoothed,
        still=0.0,
        payload=np.append(np.zeros(len(nodes) - 1), load / GRAVITY),
    )


def fitted_parameters(model: ObjectModel) -> tuple[FittedParameter, ...]:
    """How it resists bending, how it is damped and its intrinsic curvature; it hardly stretches, and its clamps do not
    give way."""
    length = float(model.graph.rest_lengths.sum())
    # A rod of these rigidities bends under its own weight within 1 % of its length, and within all of it.
    low, high = (model.parameters.total_mass * GRAVITY * share**3 * length**2 for share in (0.01, 1.0))
    masses = masses_along(model.graph, model.parameters.total_mass)
    longest = longest_retardation(model.parameters.flexural_rigidity, model.graph.rest_lengths, masses)
    most = 2.0 * np.pi / length
    return (
        fitted("flexural_rigidity", low, high, 0.1, unit="N m^2", logarithmic=True),
        fitted("retardation_time", min(1e-5, longest / 2.0), longest, 0.5, unit="s", logarithmic=True),
        fitted("drag", 0.0, 20.0, 0.2, unit="1/s"),
        *(fitted(name, -most, most, DIAGNOSED_CURVATURE_STEP / length, unit="1/m") for name in INTRINSIC_CURVATURE),
    )


def masses_along(graph: SpringGraph, total: float) -> np.ndarray:
    """[N] float32 kg: each node's share is its share of the length."""
    halves = np.pad(graph.rest_lengths / 2.0, 1)
    shares = (halves[:-1] + halves[1:]) / halves.sum() / 2.0
    return np.asarray((total * shares).astype(np.float32))


def require_chain(graph: SpringGraph) -> None:
    """Check that springs link each node to the next.

    Raises:
        TwinError: they do not.
    """
    if not np.array_equal(graph.springs, chain(len(graph.positions))):
        raise TwinError("the springs of a rod must link each node to the next, in order")


KIND = Kind(
    name=NAME,
    from_markers=FromMarkers(body=rod_body, unknowns=unknowns, place=place, starts_as_seen=True),
    node_masses=masses_along,
    require_graph=require_chain,
    is_line=True,
    # Its springs hardly stretch, and it bends without any. What effects on springs gained in a cable that lacks
    # nothing, up to 108, was of how it stretches.
    cannot_tell=frozenset({Need.SPRINGS, Need.THIN}),
    fitted=fitted_parameters,
    # A line has no surface.
    faces=lambda graph: np.zeros((0, 3), np.int32),
)
