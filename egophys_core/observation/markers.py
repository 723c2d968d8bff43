"""Objects seen at a few markers: a lattice from a template, carried by held points, with a node at every marker.

Held points stand for a clamp: the layer of the lattice nearest to them is its face, and moves with them as one piece.
A node in the middle of the other end's face carries a load; neither it nor markers weigh anything. What is slender is a
rod (`rods.py`), a line instead of a lattice: straight, or bent alike all along, when nothing acts on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.kinds.rods import PIECES, SLENDER, Chain, bend_to, find_chain, rod_nodes
from egophys_core.kinds.template import Lattice, Template, box_template, cut, lattice
from egophys_core.observation.clamps import carried_by_clamps, clamp_groups, rigid_fit, smoothed_clamps, stands_still
from egophys_core.observation.contact import Contact, Hand
from egophys_core.observation.first_motion import first_motion
from egophys_core.observation.problem import FitProblem
from egophys_core.simulation import ContactKind, Controls
from egophys_core.twin import GRAVITY, ObjectKind, ObjectModel, SpringGraph, SpringKind, chain, level_axes
from egophys_core.twin.statics import equilibrium

MOST_MARKERS = 12
"""Tracks up to which an episode is one of markers: fewer than the patches of a seen surface."""

ANCHORS = 6
"""Nodes of the lattice that a marker hangs on."""

NODES_OF_A_CLAMP = 2
"""Of a rod, which a clamp holds (`rods.rod_nodes`)."""

SECTION_OF_A_ROD = 1e-4
"""m^2, across a rod that no template describes: whatever it is, the rod moves alike."""

SAME_PLACE = 1e-6
"""Metres within which nodes have no way between them, which a spring needs."""

MOST_RELIEF = 0.5
"""Of its mass that a cell can be lighter by for what hangs on it; a light node would ask for short steps."""

RELEASED_M = 0.004
"""Metres that markers have moved when they are taken to move: more than a clamp that is touched shakes them."""

RELEASED_WITHIN = 0.1
"""Seconds after the start: what begins to move later was not held back at the start."""

OWN_MARKERS = 0.01
"""Metres within which the last nodes of a twin of markers lie where it was built from them."""

WIDE = 0.005
"""Metres that held points lie away from one line, from which they alone tell how a clamp is turned."""

NO_TABLE = 10.0
"""Metres below the lowest marker."""


@dataclass(frozen=True, kw_only=True)
class MarkerBody:
    """A template placed in an episode."""

    kind: ObjectKind
    """A solid, or a rod."""
    graph: SpringGraph
    """The lattice, then a node in the middle of its end face at +x, then one for each marker; or a rod's nodes."""
    grasp: np.ndarray
    """[C + P + G, 3] metres: the episode's held points, then its markers in frame 0, then the clamped nodes. Of a rod
    they lie on its axis."""
    spacing: float
    """Metres, edge of a cubic cell of the lattice, or length of a piece of the rod."""
    volume: float
    """m^3."""
    length: float
    """Metres that are free."""
    notes: tuple[str, ...]
    """What was assumed, in words."""


def is_sparse(episode: Episode) -> bool:
    """Whether an episode shows an object at a few markers."""
    return episode.points.shape[1] <= MOST_MARKERS


def marker_body(episode: Episode, template: Template | None) -> MarkerBody:
    """What an object is that an episode shows: a rod where markers lie along one, else a template, or a bar.

    Raises:
        EpisodeError: no held points, markers that are never seen all at once, or that do not tell a direction.
    """
    held, tracks = _first_places(from_all_seen(episode))
    slender = template is None or template.length >= SLENDER * template.size[1:].max()
    along = find_chain(held, clamp_groups(episode.controllers), tracks) if slender else None
    return _bar_body(episode, held, tracks, template) if along is None else _rod_body(held, tracks, along, template)


def _bar_body(episode: Episode, held: np.ndarray, tracks: np.ndarray, template: Template | None) -> MarkerBody:
    """Place a template, by default a bar as long and thick as the markers say, where an episode shows the object.

    The first clamp is at the template's -x end, a second one, if its centre is nearer to the other end, at +x.

    Raises:
        EpisodeError: the markers do not tell a direction.
    """
    clamps = [held[members].mean(axis=0) for members in clamp_groups(episode.controllers)]
    frame, near, span = _frame(episode, clamps, tracks)
    notes = []
    if template is None:
        template = _bar(tracks, frame, near, span)
        notes.append(f"no template: taken for a bar of {' x '.join(f'{edge:.3g}' for edge in template.size)} m")
    if len(clamps) > 1:
        # What is longer than the way between two clamps lies inside them.
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
        kind=ObjectKind.SOLID,
        graph=graph,
        grasp=np.concatenate([held, tracks, nodes[np.isin(cells.layers, held_layers)]]).astype(np.float32),
        spacing=cells.spacing,
        volume=cells.spacing**3 * len(graph.positions),
        length=template.length,
        notes=tuple(notes),
    )


def from_all_seen(episode: Episode) -> Episode:
    """The episode from the first frame on that shows all its markers: they tell how the object lies.

    Raises:
        EpisodeError: no frame but perhaps the last does.
    """
    seen = episode.visible
    first = int(np.argmax(seen.all(axis=1)))
    if not seen[first].all() or first > episode.frames - 2:
        hidden = int(np.argmin(seen.sum(axis=0)))
        raise EpisodeError(
            f"{episode.name}: no frame shows all {seen.shape[1]} markers, and a twin of markers begins with one; leave "
            f"out marker {episode.point_ids[hidden]}, seen in {seen[:, hidden].sum()} of {episode.frames} frames"
        )
    if first == 0:
        return episode
    rest = slice(first, None)
    return replace(
        episode,
        times=episode.times[rest] - episode.times[first],
        points=episode.points[rest],
        confidence=episode.confidence[rest],
        controllers=episode.controllers[rest],
    )


def _first_places(episode: Episode) -> tuple[np.ndarray, np.ndarray]:
    """Held points [C, 3] and markers [P, 3] in the first frame, metres.

    Raises:
        EpisodeError: none is held.
    """
    if episode.controllers.shape[1] == 0:
        raise EpisodeError(f"{episode.name}: no held points; record the markers of the clamp as controller points")
    return episode.controllers[0].astype(np.float64), episode.points[0].astype(np.float64)


def _rod_body(held: np.ndarray, tracks: np.ndarray, along: Chain, template: Template | None) -> MarkerBody:
    """A rod, straight from where it is first free on, with all that was recorded on its axis."""
    length = along.length if along.has_far_clamp or template is None else max(along.length, template.length)
    reaches, clamped = rod_nodes(along, len(held), length)
    begin = held[int(np.abs(along.reaches[: len(held)]).argmin())]
    axis = tracks[-1] - held[0]
    axis /= np.linalg.norm(axis)
    nodes = begin + reaches[:, None] * axis
    section = SECTION_OF_A_ROD if template is None else float(np.prod(template.size[1:]))
    return MarkerBody(
        kind=ObjectKind.ROD,
        graph=SpringGraph(
            positions=nodes.astype(np.float32),
            springs=chain(len(nodes)),
            kinds=np.full(len(nodes) - 1, SpringKind.STRUCTURAL, np.uint8),
            rest_lengths=np.diff(reaches).astype(np.float32),
            surface=np.ones(len(nodes), bool),
        ),
        grasp=np.concatenate([begin + along.reaches[:, None] * axis, nodes[clamped]]).astype(np.float32),
        spacing=length / PIECES,
        volume=section * float(np.ptp(reaches)),
        length=length,
        notes=(
            f"a rod: {1000 * length:.1f} mm of it are free, along the curve through held points and markers, "
            "alike all along",
        ),
    )


def place_markers(model: ObjectModel, grasp: np.ndarray, episode: Episode, *, load: float = 0.0) -> FitProblem:
    """A twin of markers in an episode of its object.

    It is placed by its held points if they tell how a clamp is turned: a hand that still holds it back in frame 0
    bends it. Fewer of them tell it together with the markers of frame 0, as one rigid body. If it is let go at the
    start its episode begins where its swing first turns, and it begins bent as the markers say. A rod begins along
    the curve through held points and markers, as fast as these are. What comes before all markers are seen is left out.

    Args:
        grasp: of the twin, as in `MarkerBody`.
        load: N, the weight of what hangs at its free end all the time.

    Raises:
        EpisodeError: other markers or held points than the twin was built with.
    """
    episode = from_all_seen(episode)
    count, markers = episode.controllers.shape[1], episode.points.shape[1]
    nodes = model.graph.positions.astype(np.float64)
    held, tracks = episode.controllers[0].astype(np.float64), episode.points[0].astype(np.float64)
    known = count + markers
    bound = _nodes_of_markers(model, grasp[count:known])
    own = _has_room_for(model, grasp, known) and np.allclose(nodes[bound], grasp[count:known], atol=OWN_MARKERS)
    if not own:
        raise EpisodeError(
            f"{episode.name}: its {markers} markers and {count} held points are not those of the twin; is it a twin of "
            "these markers (egophys build --template)?"
        )
    onset = find_onset(episode)
    shown = _from_onset(episode, onset)
    recorded, clamped = grasp[:known].astype(np.float64), grasp[known:].astype(np.float64)
    if model.kind == ObjectKind.ROD:
        # What is bent along a line passes every small turn of a clamp on.
        hands = smoothed_clamps(shown.controllers.astype(np.float64), shown.times)
        seen, moving = first_motion(np.concatenate([shown.controllers, shown.points], axis=1), shown.times)
        bend = bend_to(recorded, np.concatenate([hands[0], seen[count:]]), moving)
        start, velocities, clamped = bend.place(nodes), bend.velocities(nodes), bend.place(clamped)
        driven = carried_by_clamps(hands, clamped, still=0.0)
    else:
        seen = held if _spread(held) > WIDE else np.concatenate([held, tracks])
        turn, shift = rigid_fit(recorded[: len(seen)], seen)
        clamped = clamped @ turn.T + shift
        start, velocities = _bent(model, nodes @ turn.T + shift, clamped, onset.markers), np.zeros_like(nodes)
        driven = carried_by_clamps(shown.controllers.astype(np.float64), clamped)
    driven = np.concatenate([shown.controllers, driven], axis=1)
    contact = np.full(driven.shape[:2], ContactKind.HOLD, np.uint8)
    contact[:, :count] = ContactKind.NONE
    hand = Hand(
        controllers=np.arange(count, driven.shape[1]),
        contacts=(Contact(first=0, last=shown.frames - 1, kind=ContactKind.HOLD),),
    )
    return FitProblem(
        episode=shown,
        hands=(hand,),
        start=start.astype(np.float32),
        velocities=velocities.astype(np.float32),
        bound=bound,
        controls=Controls(
            times=shown.times,
            positions=driven.astype(np.float32),
            contact=contact,
            payload=_payload(model, markers, load),
        ),
    )


def _nodes_of_markers(model: ObjectModel, markers: np.ndarray) -> np.ndarray:
    """[P] the node that each marker [P, 3] is: of a lattice the last ones, of a rod the one at its place."""
    nodes = model.graph.positions
    if model.kind == ObjectKind.ROD:
        return np.asarray(cKDTree(nodes).query(markers)[1])
    return np.arange(len(nodes) - len(markers), len(nodes))


def _has_room_for(model: ObjectModel, grasp: np.ndarray, known: int) -> bool:
    """Whether a twin may have been built from so many recorded points: the others are its clamped nodes."""
    if model.kind != ObjectKind.ROD:
        return len(grasp) > known
    far_clamp = np.array_equal(grasp[-1], model.graph.positions[-1])
    return len(grasp) == known + NODES_OF_A_CLAMP * (1 + far_clamp)


def _spread(points: np.ndarray) -> float:
    """Metres by which points [P, 3] lie away from one line, root mean square; 0 for fewer than three."""
    if len(points) < 3:
        return 0.0
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(points)))


@dataclass(frozen=True, kw_only=True)
class Onset:
    """A moment from which an object can be simulated: it is at rest, if only for that moment."""

    frame: int
    """The last frame that is not after it."""
    time: float
    """Seconds."""
    markers: np.ndarray
    """[P, 3] metres, then."""


def find_onset(episode: Episode) -> Onset:
    """The first turning point of what is let go at the start, or the start itself.

    How a hand lets go, and a load that is slack at first, takes some hundredths of a second that no model knows. Where
    the swing turns for the first time speeds are 0 and markers are seen: a parabola through three frames gives both.
    """
    points, times = episode.points.astype(np.float64), episode.times
    way = np.linalg.norm(np.nanmean(points - points[0], axis=1), axis=1)
    gone = int(np.argmax(way > RELEASED_M))
    start = Onset(frame=0, time=0.0, markers=points[0])
    if gone == 0 or times[gone] > RELEASED_WITHIN or not stands_still(episode.controllers):
        return start
    turns = [frame for frame in range(gone, episode.frames - 1) if way[frame - 1] < way[frame] >= way[frame + 1]]
    if not turns or not np.isfinite(points[turns[0] - 1 : turns[0] + 2]).all():
        return start
    around = slice(turns[0] - 1, turns[0] + 2)
    curve = np.polyfit(times[around] - times[turns[0]], way[around], 2)
    turn = float(times[turns[0]] - curve[1] / (2.0 * curve[0])) if curve[0] < 0 else float(times[turns[0]])
    each = np.polyfit(times[around] - turn, points[around].reshape(3, -1), 2)
    return Onset(frame=int(np.searchsorted(times, turn, side="right")) - 1, time=turn, markers=each[2].reshape(-1, 3))


def _from_onset(episode: Episode, onset: Onset) -> Episode:
    """The episode from there on, the moment itself its first frame; without a table."""
    frames = slice(onset.frame, None)
    times, points = episode.times[frames] - onset.time, episode.points[frames].copy()
    times[0], points[0] = 0.0, onset.markers
    # A frame that follows at once would be no frame: it takes the place of the moment.
    if len(times) > 2 and times[1] < 0.05 * times[2]:
        times, points, frames = np.delete(times, 1), np.delete(points, 1, axis=0), slice(onset.frame + 1, None)
    return replace(
        episode,
        times=times,
        points=points.astype(np.float32),
        confidence=episode.confidence[frames],
        controllers=episode.controllers[frames],
        # What is clamped needs no table, and none is told: z = 0 may be the floor of the laboratory.
        ground_height=float(np.nanmin(episode.points[..., 2])) - NO_TABLE,
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


def _frame(episode: Episode, clamps: Sequence[np.ndarray], tracks: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Axes [3, 3] of the template in the world as rows, the first clamp's centre [3], and the way to the other end."""
    near = clamps[0]
    far = clamps[-1] if len(clamps) > 1 else tracks.mean(axis=0)
    span = float(np.linalg.norm(far - near))
    if span < 1e-3:
        raise EpisodeError(f"{episode.name}: the held points lie amid the markers and tell no direction")
    return level_axes(far - near), near, span


def _bar(tracks: np.ndarray, frame: np.ndarray, near: np.ndarray, span: float) -> Template:
    """A bar that is as long as the markers reach and as thick as they lie around its axis."""
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
    if model.kind == ObjectKind.ROD:
        return np.append(np.zeros(len(positions) - 1), load / GRAVITY)
    anchors = _anchors(positions[:-hung], positions[-hung:])
    shares = np.bincount(anchors.ravel(), minlength=len(positions)) / anchors.shape[1]
    payload = -model.node_masses.astype(np.float64) * np.minimum(shares, MOST_RELIEF)
    payload[-hung] += load / GRAVITY
    return payload
