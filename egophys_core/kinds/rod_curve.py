"""The curve of a rod: slender, as a cable, alike all along and bent in every record along the curve of what is seen.

Held points and markers of a cable lie on its centre line, one after the other, and tell its curve in a frame: a spline
through them. Its twin is its centre line, as long as the curve, which hardly stretches and resists bending.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import distance_matrix

from egophys_core.geometry import smallest_rotation
from egophys_core.twin import GRAVITY

FEWEST_STATIONS = 4
"""Clamps and markers along a rod: fewer tell no curve."""

ALIGNED = 0.7
"""Cosine between the line of a clamp's held points and the chord to the nearest marker, from which they lie on it."""

FLAT = 0.2
"""Width over length of a clamp's held points up to which they lie on a line."""

STRETCH = 0.001
"""Share by which a rod that hangs down freely is longer than at rest."""

PIECES = 30
"""Into which the free length of a rod is cut: three and more between markers."""

SHORTEST_PIECE = 0.25
"""Of a usual piece: what was recorded nearer to each other shares a node, or steps would have to be too short."""

MOST_DAMPING_RATE = 1e5
"""1/s, of the fastest mode, that a rod's own damping may have: more asks for too many substeps."""

FINE = 20
"""Places per station at which a curve is measured."""


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Held points and markers along a rod, in their order."""

    arc_lengths: np.ndarray
    """[C + P] metres of each held point, then of each marker, along the rod from where it is free on."""
    length: float
    """Metres from there to the second clamp, or to the last marker."""
    has_far_clamp: bool


def find_chain(held: np.ndarray, clamps: list[np.ndarray], tracks: np.ndarray) -> Chain | None:
    """How held points [C, 3] and markers [P, 3] lie along a rod; None if they do not lie one after the other.

    Args:
        clamps: indices of the held points of each clamp, the first of which is at the rod's beginning.
    """
    groups = [station for clamp in clamps for station in _stations(held, clamp, tracks)]
    owners = [index for index, clamp in enumerate(clamps) for _ in _stations(held, clamp, tracks)]
    places = np.array([*(held[group].mean(axis=0) for group in groups), *tracks])
    owner = np.array([*owners, *[-1] * len(tracks)])
    order = _path(places) if len(places) >= FEWEST_STATIONS and len(clamps) <= 2 else None
    if order is None:
        return None
    order = order if owner[order[0]] == 0 else order[::-1]
    # From one clamp over all markers to the other, if there is one.
    ends = (np.sum(owner == 0), len(order) - np.sum(owner == 1))
    if not ((owner[order[: ends[0]]] == 0).all() and (owner[order[ends[0] : ends[1]]] == -1).all()):
        return None
    chords = np.diff(places[order], axis=0)
    if (np.einsum("si,si->s", chords[1:], chords[:-1]) <= 0.0).any():
        return None
    arc_lengths = np.zeros(len(places))
    arc_lengths[order] = _arc_lengths(places[order])
    arc_lengths -= arc_lengths[order[ends[0] - 1]]
    of_held = np.zeros(len(held))
    for group, arc_length in zip(groups, arc_lengths, strict=False):
        of_held[group] = arc_length
    far = len(clamps) == 2
    return Chain(
        arc_lengths=np.concatenate([of_held, arc_lengths[len(groups) :]]),
        length=float(arc_lengths[order[ends[1]]] if far else arc_lengths[order[-1]]),
        has_far_clamp=far,
    )


def axial_stiffness(mass_per_length: float, length: float) -> float:
    """EA in N of a rod, kg/m and metres, that hardly stretches: its own weight makes it longer by `STRETCH`."""
    return mass_per_length * GRAVITY * length / (2.0 * STRETCH)


def rod_nodes(chain: Chain, held: int, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a rod has nodes: where it is free from on, at its markers, and evenly between.

    A clamp holds the node where the rod is free from on and one a piece farther in, and so the rod's direction.

    Args:
        held: how many points are held.
        length: metres that are free.

    Returns:
        [N] arc lengths in metres from where the rod is free on, and [N] whether a clamp holds the node.
    """
    piece = length / PIECES
    clamped = np.array([-piece, 0.0, *([length, length + piece] if chain.has_far_clamp else [])])
    stops = np.concatenate([clamped, chain.arc_lengths[held:], [] if chain.has_far_clamp else [length]])
    order = np.argsort(stops)
    station = np.cumsum(np.diff(stops[order], prepend=-np.inf) > SHORTEST_PIECE * piece) - 1
    stations = np.bincount(station, stops[order]) / np.bincount(station)
    is_clamped = np.bincount(station, order < len(clamped)) > 0
    counts = np.maximum(np.round(np.diff(stations) / piece), 1).astype(int)
    at = np.concatenate([[0], np.cumsum(counts)])
    nodes = np.arange(at[-1] + 1)
    return np.interp(nodes, at, stations), np.isin(nodes, at[is_clamped])


@dataclass(frozen=True, kw_only=True)
class Bend:
    """From a rod that is straight to the curve that it has in a frame."""

    origin: np.ndarray
    """[3] metres, a place on the straight rod's axis."""
    along: np.ndarray
    """[3] the axis."""
    curve: CubicSpline
    """Places in metres by the arc length from the origin: the distance along the axis of the straight rod."""
    motion: CubicSpline
    """Their velocities in m/s."""
    ends: tuple[float, float]
    """Metres, the arc lengths of the outermost recorded points; beyond them the rod is straight."""

    def place(self, points: np.ndarray) -> np.ndarray:
        """[N, 3] where points [N, 3] of the straight rod are: plane cross-sections go by parallel transport, without
        twist (Bishop, Amer. Math. Monthly 82 (1975) 246)."""
        beside = points - self.origin
        arc_lengths = beside @ self.along
        across = beside - arc_lengths[:, None] * self.along
        placed = np.empty_like(points)
        transport, before = np.eye(3), self.along
        for arc_length in np.unique(np.concatenate([arc_lengths, np.linspace(*self.ends, FINE)])):
            inside = float(np.clip(arc_length, *self.ends))
            tangent = self.curve(inside, 1)
            tangent /= np.linalg.norm(tangent)
            transport, before = smallest_rotation(before, tangent) @ transport, tangent
            here = arc_lengths == arc_length
            placed[here] = self.curve(inside) + (arc_length - inside) * tangent + across[here] @ transport.T
        return placed

    def velocities(self, points: np.ndarray) -> np.ndarray:
        """[N, 3] m/s, of points [N, 3] on the straight rod's axis; beyond the outermost recorded ones as there."""
        return np.asarray(self.motion(np.clip((points - self.origin) @ self.along, *self.ends)))


def bend_to(recorded: np.ndarray, seen: np.ndarray, moving: np.ndarray) -> Bend:
    """The curve through points as they are seen [K, 3], with velocities [K, 3], that lie at `recorded` [K, 3] on the
    straight rod."""
    origin, along = recorded[0], np.linalg.svd(recorded - recorded.mean(axis=0))[2][0]
    rounded = np.round((recorded - origin) @ along, 6)
    arc_lengths, station = np.unique(rounded, return_inverse=True)

    def through(values: np.ndarray) -> CubicSpline:
        means = [values[station == index].mean(axis=0) for index in range(len(arc_lengths))]
        return CubicSpline(arc_lengths, means, bc_type="natural")

    return Bend(
        origin=origin,
        along=along,
        curve=through(seen),
        motion=through(moving),
        ends=(float(arc_lengths[0]), float(arc_lengths[-1])),
    )


def longest_retardation(rigidity: float, lengths: np.ndarray, masses: np.ndarray) -> float:
    """Seconds of retardation that a rod's simulation can afford; its own damps slow modes, fast ones are gone anyway.

    Args:
        rigidity: N m^2.
        lengths: [N - 1] metres of the pieces between nodes.
        masses: [N] kg.
    """
    return MOST_DAMPING_RATE / (rigidity * fastest_bending(lengths, masses))


def fastest_bending(lengths: np.ndarray, masses: np.ndarray) -> float:
    """Largest omega^2 in 1/s^2 of a rod of 1 N m^2, lengths [N - 1] and masses [N]."""
    h = lengths.astype(np.float64)
    curvatures = np.zeros((len(h) - 1, len(masses)))
    rows = np.arange(len(curvatures))
    curvatures[rows, rows], curvatures[rows, rows + 1] = 1 / h[:-1], -1 / h[:-1] - 1 / h[1:]
    curvatures[rows, rows + 2] = 1 / h[1:]
    scaled = curvatures * np.sqrt(2.0 / (h[:-1] + h[1:]))[:, None] / np.sqrt(masses)
    return float(np.linalg.norm(scaled, 2) ** 2)


def _stations(held: np.ndarray, clamp: np.ndarray, tracks: np.ndarray) -> list[np.ndarray]:
    """The held points [C, 3] of a clamp in groups of one place on the rod each: all together, or each its own."""
    points, centre = held[clamp], held[clamp].mean(axis=0)
    sizes, (axis, *_) = np.linalg.svd(points - centre, full_matrices=False)[1:]
    towards = tracks[np.linalg.norm(tracks - centre, axis=1).argmin()] - centre
    on_it = len(points) > 1 and abs(axis @ towards) > ALIGNED * np.linalg.norm(towards) and sizes[1] <= FLAT * sizes[0]
    return [np.array([each]) for each in clamp] if on_it else [clamp]


def _path(places: np.ndarray) -> np.ndarray | None:
    """The order in which places [S, 3] are neighbours, if their least spanning tree is a path."""
    tree = minimum_spanning_tree(distance_matrix(places, places))
    linked = (tree + tree.T).toarray() > 0.0
    counts = linked.sum(axis=1)
    if counts.max() > 2 or counts.min() == 0:
        return None
    return np.asarray(breadth_first_order(tree, int(np.argmin(counts)), directed=False)[0])


def _arc_lengths(places: np.ndarray) -> np.ndarray:
    """[S] metres from the first of places [S, 3] along the spline through them."""
    chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    fine = np.interp(np.arange((len(places) - 1) * FINE + 1) / FINE, np.arange(len(places)), chords)
    steps = np.linalg.norm(np.diff(CubicSpline(chords, places, bc_type="natural")(fine), axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])[::FINE]
