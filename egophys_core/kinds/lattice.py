"""Lattices: elastic bodies held in clamps and seen at a few markers, filled with the cells of a template.

Held points stand for a clamp: the layer of the lattice nearest to them is its face, and moves with them as one piece.
A node in the middle of the other end's face carries a load, and each marker has a node; none of these weighs anything.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from egophys_core.effects.traits import Need
from egophys_core.errors import EpisodeError
from egophys_core.geometry import rigid_fit
from egophys_core.kinds.clamped import OVERDAMPED, SOME_DRAG, clamped_parameters
from egophys_core.kinds.kind import (
    FittedParameter,
    FromMarkers,
    Kind,
    MarkerBody,
    PlacedMarkers,
    SeenMarkers,
    Unknowns,
    equal_masses,
)
from egophys_core.kinds.spring_body import fitted, fitted_of_springs
from egophys_core.kinds.surface_faces import faces_of_body
from egophys_core.kinds.template import Lattice, Template, box_template, cut, lattice, stiffness_of_modulus
from egophys_core.twin import GRAVITY, ObjectModel, SpringGraph, SpringKind, level_axes, per_kind
from egophys_core.twin.statics import equilibrium

NAME = "lattice"

FORMER_NAME = "solid"
"""What twins of markers were called, that are no rods, before lattices were a kind of their own."""

ANCHORS = 6
"""Nodes of the lattice that a marker hangs on."""

SAME_PLACE = 1e-6
"""Metres within which nodes have no distance between them, which a spring needs."""

MOST_RELIEF = 0.5
"""Of its mass that a cell can be lighter by for what hangs on it; a light node would ask for short steps."""

OWN_MARKERS = 0.01
"""Metres within which the last nodes of a twin of markers lie where it was built from them."""

WIDE = 0.005
"""Metres that held points lie away from one line, from which they alone tell how a clamp is turned."""

MODULI = np.geomspace(3e3, 1e7, 32)
"""Young's moduli in Pa, from a sponge to rubber, at which static deflection is looked at."""

DAMPING_S = 1e-5
"""Seconds, first guess of dashpot over spring. Dashpots act on all relative motion, so a slender body's turning too."""

MOST_DAMPING = 30.0
"""Dashpot over node mass, 1/s, in a diagnosis, unless that of a stiff template is larger."""


def was_called_solid(model: ObjectModel) -> bool:
    """Whether a model of an earlier version is a lattice: a controller point for each held node, and springs one way
    of the cells after the other; those of a fitted toy are sorted by their nodes, and no refit changes their order."""
    if model.kind != FORMER_NAME or model.parameters.controller_neighbours != 1:
        return False
    springs = model.graph.springs.astype(np.int64)
    return bool((np.diff(springs[:, 0] * len(model.graph.positions) + springs[:, 1]) < 0).any())


def lattice_body(seen: SeenMarkers, template: Template | None) -> MarkerBody:
    """A template, by default a bar as long and thick as the markers say, where markers show the object.

    The first clamp is at the template's -x end, a second one, if its centre is nearer to the other end, at +x. The
    graph is that of the cells, then a node in the middle of the end face at +x, then one for each marker.

    Raises:
        EpisodeError: the markers do not tell a direction.
    """
    held, tracks = seen.held, seen.tracks
    clamps = [held[members].mean(axis=0) for members in seen.clamps]
    frame, near, span = _frame(seen.name, clamps, tracks)
    notes = []
    if template is None:
        template = _bar(tracks, frame, near, span)
        notes.append(f"no template: taken for a bar of {' x '.join(f'{edge:.3g}' for edge in template.size)} m")
    if len(clamps) > 1:
        # What is longer than the distance between two clamps lies inside them.
        inside = max(template.length - span, 0.0)
        template = cut(template, inside / 2, inside / 2)
    centre = near + frame[0] * template.length / 2
    along = [float((clamp - centre) @ frame[0]) for clamp in clamps]
    ends = (True, any(place > 0.25 * template.length for place in along))
    cells = lattice(template, held_ends=ends)
    held_layers = [int(np.abs(_layer_places(cells) - place).argmin()) for place in along]
    towards = "the other clamp" if ends[1] else "the markers"
    notes.append(
        f"its first end lies at the clamp's centre and it points to {towards}, {1000 * span:.1f} mm from there; "
        f"{1000 * template.length:.1f} mm of it are free; its width is taken to be level"
    )
    nodes = cells.nodes @ frame + centre
    last = cells.nodes[cells.layers == cells.layers.max()].mean(axis=0)
    end = np.array([template.length / 2, *last[1:]]) @ frame + centre
    graph = _graph(nodes, cells, np.concatenate([[end], tracks]))
    return MarkerBody(
        kind=NAME,
        graph=graph,
        grasp=np.concatenate([held, tracks, nodes[np.isin(cells.layers, held_layers)]]).astype(np.float32),
        spacing=cells.spacing,
        volume=cells.spacing**3 * len(graph.positions),
        length=template.length,
        is_size_known=True,
        notes=tuple(notes),
    )


def unknowns(body: MarkerBody, known: int, density: float) -> Unknowns:
    """One stiffness over node mass, 1/s^2, and dashpot over stiffness, s; and the pitch and yaw of its clamp, rad."""
    node_mass = density * body.spacing**3
    rates = np.log(stiffness_of_modulus(MODULI, body.spacing) / node_mass)

    def model(numbers: np.ndarray) -> tuple[MarkerBody, ObjectModel]:
        rate, time, drag, pitch, yaw = (float(number) for number in numbers)
        placed = turned(body, known, pitch=pitch, yaw=yaw)
        stiffness = float(np.exp(rate)) * node_mass
        damping = float(np.exp(time)) * stiffness
        return placed, lattice_model(placed, density=density, stiffness=stiffness, damping=damping, drag=drag)

    return Unknowns(
        steps=np.array([0.05, 0.7, 1.0, 0.005, 0.005]),
        low=np.array([-np.inf, -np.inf, 0.0, -np.inf, -np.inf]),
        static_deflection=np.array([[rate, np.log(DAMPING_S), OVERDAMPED, 0.0, 0.0] for rate in rates]),
        ring_down=np.array([np.nan, np.log(DAMPING_S), SOME_DRAG, 0.0, 0.0]),
        model=model,
    )


def lattice_model(body: MarkerBody, *, density: float, stiffness: float, damping: float, drag: float) -> ObjectModel:
    """The model of a lattice with one stiffness, N/m, one dashpot, N s/m, and a drag, 1/s; clamped as stiffly."""
    return ObjectModel(
        kind=NAME,
        graph=body.graph,
        parameters=clamped_parameters(body, density=density, stiffness=stiffness, damping=damping, drag=drag),
        stiffness=per_kind(body.graph, stiffness, 1.0),
    )


def turned(body: MarkerBody, known: int, *, pitch: float, yaw: float) -> MarkerBody:
    """The body turned about its clamp, upward for a positive pitch and to its left for a positive yaw, rad.

    Held points tell where a clamp is, and not to a degree how what it holds points. The first `known` points of its
    grasp, which were recorded, stay.
    """
    clamp = body.grasp[known:].astype(np.float64)
    middle = clamp.mean(axis=0)
    along = (body.graph.positions - middle).mean(axis=0)
    level = np.array([along[1], -along[0], 0.0])
    level /= max(float(np.linalg.norm(level)), 1e-9)
    up = np.cross(level, along) / np.linalg.norm(along)
    turn = (Rotation.from_rotvec(pitch * level) * Rotation.from_rotvec(yaw * up)).as_matrix()
    nodes = (body.graph.positions - middle) @ turn.T + middle
    grasp = np.concatenate([body.grasp[:known], (clamp - middle) @ turn.T + middle])
    return replace(
        body,
        graph=replace(body.graph, positions=nodes.astype(np.float32)),
        grasp=grasp.astype(np.float32),
        notes=(*body.notes, f"it is turned {1000 * pitch:.1f} mrad up and {1000 * yaw:.1f} mrad to its left"),
    )


def place(model: ObjectModel, grasp: np.ndarray, seen: SeenMarkers, load: float) -> PlacedMarkers | None:
    """A lattice in a record.

    It is placed by its held points if they tell how a clamp is turned: a hand that still holds it back in frame 0
    bends it. Fewer of them tell it together with the markers of frame 0, as one rigid body. If it is let go at the
    start its episode begins where its ring-down first turns back, and it begins bent as the markers say.
    """
    markers, known = len(seen.tracks), len(seen.held) + len(seen.tracks)
    nodes = model.graph.positions.astype(np.float64)
    bound = np.arange(len(nodes) - markers, len(nodes))
    of_markers = grasp[len(seen.held) : known]
    if len(grasp) <= known or not np.allclose(nodes[bound], of_markers, atol=OWN_MARKERS):
        return None
    recorded, clamped = grasp[:known].astype(np.float64), grasp[known:].astype(np.float64)
    telling = seen.held if _spread(seen.held) > WIDE else np.concatenate([seen.held, seen.tracks])
    turn, shift = rigid_fit(recorded[: len(telling)], telling)
    clamped = clamped @ turn.T + shift
    return PlacedMarkers(
        start=_bent(model, nodes @ turn.T + shift, clamped, seen.onset),
        velocities=np.zeros_like(nodes),
        bound=bound,
        clamped=clamped,
        hands=seen.hands,
        still=None,
        payload=_payload(model, markers, load),
    )


def fitted_parameters(model: ObjectModel) -> tuple[FittedParameter, ...]:
    """Its springs and its drag; its static deflection tells how stiff it is, as a clamp does not give way."""
    return (*fitted_of_springs(model, most_damping=MOST_DAMPING), fitted("drag", 0.0, 20.0, 0.2, unit="1/s"))


def _spread(points: np.ndarray) -> float:
    """Metres by which points [P, 3] lie away from one line, root mean square; 0 for fewer than three."""
    if len(points) < 3:
        return 0.0
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(points)))


def _frame(name: str, clamps: list[np.ndarray], tracks: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Axes [3, 3] of the template in the world as rows, the first clamp's centre [3], the distance to the other end."""
    near = clamps[0]
    far = clamps[-1] if len(clamps) > 1 else tracks.mean(axis=0)
    span = float(np.linalg.norm(far - near))
    if span < 1e-3:
        raise EpisodeError(f"{name}: the held points lie amid the markers and tell no direction")
    return level_axes(far - near), near, span


def _bar(tracks: np.ndarray, frame: np.ndarray, near: np.ndarray, span: float) -> Template:
    """A bar that is as long as the markers extend and as thick as they lie around its axis."""
    around = (tracks - near) @ frame.T
    thickness = max(2.0 * float(np.linalg.norm(around[:, 1:], axis=1).mean()), 0.05 * span)
    return box_template(span, min(thickness, 0.5 * span), min(thickness, 0.5 * span))


def _layer_places(cells: Lattice) -> np.ndarray:
    """[L] metres along x of each layer; infinitely far where a mesh has none."""
    places = np.full(cells.layers.max() + 1, np.inf)
    places[cells.layers] = cells.nodes[:, 0]
    return places


def _graph(nodes: np.ndarray, cells: Lattice, places: np.ndarray) -> SpringGraph:
    """The cells and a node at each of some places [Q, 3], which hangs on the cells around it, not on one just there."""
    anchors = _anchors(nodes, places)
    hung = np.stack([anchors.ravel(), np.repeat(len(nodes) + np.arange(len(places)), anchors.shape[1])], axis=1)
    springs = np.concatenate([cells.springs, hung])
    positions = np.concatenate([nodes, places])
    lengths = np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1)
    springs, lengths = springs[lengths > SAME_PLACE], lengths[lengths > SAME_PLACE]
    return SpringGraph(
        positions=positions.astype(np.float32),
        springs=springs.astype(np.int32),
        kinds=np.full(len(springs), SpringKind.STRUCTURAL, np.uint8),
        rest_lengths=lengths.astype(np.float32),
        surface=np.ones(len(positions), bool),
    )


def _anchors(cells: np.ndarray, places: np.ndarray) -> np.ndarray:
    """[Q, A] the cells [N, 3] on which something at places [Q, 3] hangs."""
    count = min(ANCHORS, len(cells))
    return np.asarray(cKDTree(cells).query(places, k=count)[1]).reshape(len(places), count)


def _bent(model: ObjectModel, placed: np.ndarray, clamped: np.ndarray, tracks: np.ndarray) -> np.ndarray:
    """[N, 3] metres: the nodes at rest, with their markers moved to `tracks` [P, 3] and the unclamped ones following.

    Springs to a clamp are at rest where a rollout begins; so clamped nodes are nodes, and not bent.
    """
    markers = len(tracks)
    fixed = cKDTree(clamped).query(placed)[0] < 1e-5
    fixed[-markers:] = True
    displacement = np.zeros_like(placed)
    displacement[-markers:] = tracks - placed[-markers:]
    return equilibrium(
        placed,
        model.graph.springs.astype(int),
        model.stiffness.astype(np.float64),
        fixed=fixed,
        displacement=displacement,
        forces=np.zeros_like(placed),
    )


def _payload(model: ObjectModel, markers: int, load: float) -> np.ndarray:
    """[N] kg that nodes carry beside their own masses: a load in N at the end; what hangs on cells weighs nothing.

    Instead of it the cells around it are lighter: what markers would add to the end of a beam slows it by percents.
    """
    positions, hung = model.graph.positions, markers + 1
    anchors = _anchors(positions[:-hung], positions[-hung:])
    shares = np.bincount(anchors.ravel(), minlength=len(positions)) / anchors.shape[1]
    masses = equal_masses(model.graph, model.parameters.total_mass).astype(np.float64)
    payload = -masses * np.minimum(shares, MOST_RELIEF)
    payload[-hung] += load / GRAVITY
    return payload


KIND = Kind(
    name=NAME,
    from_markers=FromMarkers(body=lattice_body, unknowns=unknowns, place=place),
    static_deflection_is_evidence=False,
    fitted=fitted_parameters,
    faces=lambda graph: faces_of_body(graph.positions),
    cannot_tell=frozenset({Need.THIN}),
)
