"""The spring graph of an object: nodes, springs between them, and which nodes can be seen."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components as label_components
from scipy.spatial import cKDTree

from egophys_core.errors import TwinError


class SpringKind(IntEnum):
    """What a spring stands for; springs of a graph are grouped in this order."""

    STRUCTURAL = 0
    """Between near nodes: in-plane stretch of a sheet, volume of a solid."""
    BENDING = 1
    """Between farther nodes of a sheet: softer, more damped, resists folding (paper, App. B.2)."""


_DTYPES = {"f": "floating-point numbers", "iu": "integers", "b": "true or false"}
"""What NumPy's letters of dtypes mean."""


MOST_STRETCHED = 10.0
"""Of the middle spring, its length where the object rests over its rest length, or the other way: by more only units
differ."""


@dataclass(frozen=True, kw_only=True)
class SpringGraph:
    """Nodes at rest and the springs between them."""

    positions: np.ndarray
    """[N, 3] float32, rest positions, metres, world."""
    springs: np.ndarray
    """[E, 2] int32, node indices i < j; structural springs first, then bending."""
    kinds: np.ndarray
    """[E] uint8, `SpringKind`."""
    rest_lengths: np.ndarray
    """[E] float32, metres, positive."""
    surface: np.ndarray
    """[N] bool: nodes on the visible surface; the others fill the inside of a solid."""

    def __post_init__(self) -> None:
        nodes, springs = len(self.positions), len(self.springs)
        for label, array, shape, kinds in (
            ("positions", self.positions, (nodes, 3), "f"),
            ("springs", self.springs, (springs, 2), "iu"),
            ("kinds", self.kinds, (springs,), "iu"),
            ("rest_lengths", self.rest_lengths, (springs,), "f"),
            ("surface", self.surface, (nodes,), "b"),
        ):
            if array.shape != shape:
                raise TwinError(f"spring graph: {label} must be {shape}, got {array.shape}")
            if array.dtype.kind not in kinds:
                raise TwinError(f"spring graph: {label} must be {_DTYPES[kinds]}, got {array.dtype}")
        self._require_nodes()
        self._require_springs()

    def _require_nodes(self) -> None:
        nodes = len(self.positions)
        if nodes == 0:
            raise TwinError("spring graph: no nodes")
        if not self.surface.any():
            raise TwinError(f"spring graph: none of its {nodes} nodes is on the surface")
        if not np.isfinite(self.positions).all():
            raise TwinError(f"spring graph: node {np.argwhere(~np.isfinite(self.positions))[0][0]} is not finite")

    def _require_springs(self) -> None:
        nodes = len(self.positions)
        if len(self.springs) == 0:
            raise TwinError(f"spring graph: no springs between its {nodes} nodes")
        if self.springs.min() < 0 or self.springs.max() >= nodes:
            raise TwinError(f"spring graph: a spring names node {self.springs.max()}, there are {nodes}")
        if not (self.springs[:, 0] < self.springs[:, 1]).all():
            spring = int(np.argmax(self.springs[:, 0] >= self.springs[:, 1]))
            raise TwinError(
                f"spring graph: spring {spring} must name its lower node first, and then another one, got "
                f"{self.springs[spring].tolist()}"
            )
        if not np.isin(self.kinds, list(SpringKind)).all():
            raise TwinError(f"spring graph: kinds must be {[int(kind) for kind in SpringKind]}, got {self.kinds.max()}")
        if not np.isfinite(self.rest_lengths).all():
            spring = int(np.argmin(np.isfinite(self.rest_lengths)))
            raise TwinError(f"spring graph: rest length of spring {spring} is {self.rest_lengths[spring]} m")
        if not (self.rest_lengths > 0).all():
            spring = int(np.argmin(self.rest_lengths))
            raise TwinError(
                f"spring graph: spring {spring} between nodes {self.springs[spring].tolist()} has rest length "
                f"{self.rest_lengths[spring]:g} m; merge nodes that coincide"
            )
        apart = float(np.median(np.linalg.norm(np.diff(self.positions[self.springs], axis=1), axis=2)))
        rest = float(np.median(self.rest_lengths))
        if not apart / MOST_STRETCHED < rest < MOST_STRETCHED * apart:
            raise TwinError(
                f"spring graph: rest lengths are {rest:g} m, where nodes at rest are {apart:g} m apart; give both in "
                "metres"
            )


def connect(positions: np.ndarray, *, radius: float, max_neighbours: int, inner_radius: float = 0.0) -> np.ndarray:
    """Springs between each node and its nearest nodes at a distance in (inner_radius, radius].

    Args:
        positions: [N, 3], metres.
        radius: longest spring, metres.
        max_neighbours: springs a node asks for; it can end with more where others ask for it.
        inner_radius: nearer nodes are skipped, metres.

    Returns:
        [E, 2] int32 pairs i < j, sorted, without repeats.
    """
    near = cKDTree(positions).query_pairs(radius * (1 + 1e-6), output_type="ndarray").astype(np.int64)
    distances = np.linalg.norm(positions[near[:, 0]] - positions[near[:, 1]], axis=1)
    near, distances = near[distances > inner_radius], distances[distances > inner_radius]
    # Both directions, each node's neighbours by distance; of equally near ones the first node counts as nearer.
    node, other = np.concatenate([near, near[:, ::-1]]).T
    order = np.lexsort((other, np.tile(distances, 2), node))
    node, other = node[order], other[order]
    rank = np.arange(len(node)) - np.searchsorted(node, node)
    pairs = np.stack([node, other], axis=1)[rank < max_neighbours]
    return _distinct(pairs, len(positions))


def connected_components(node_count: int, springs: np.ndarray) -> np.ndarray:
    """[N] int: the component each node belongs to, from springs [E, 2]."""
    links = coo_matrix((np.ones(len(springs)), (springs[:, 0], springs[:, 1])), shape=(node_count, node_count))
    return label_components(links, directed=False)[1]


def bridge_components(positions: np.ndarray, springs: np.ndarray) -> np.ndarray:
    """Add the shortest springs that make a graph of several pieces one piece.

    A tracked surface with a gap would otherwise fall apart under its own weight.

    Returns:
        [E', 2] int32 springs, sorted, E' >= E.
    """
    springs = springs.reshape(-1, 2)
    while True:
        labels = connected_components(len(positions), springs)
        if labels.max() == 0:
            return springs
        piece = np.flatnonzero(labels == labels[-1])
        rest = np.flatnonzero(labels != labels[-1])
        distances, nearest = cKDTree(positions[rest]).query(positions[piece])
        closest = np.argsort(distances, kind="stable")[:3]
        bridges = np.stack([piece[closest], rest[nearest[closest]]], axis=1)
        springs = _distinct(np.concatenate([springs, bridges]), len(positions))


def _distinct(pairs: np.ndarray, nodes: int) -> np.ndarray:
    """[E, 2] int32 pairs i < j, sorted, without repeats."""
    low, high = np.sort(pairs, axis=1).astype(np.int64).T
    codes = np.unique(low * nodes + high)
    return np.stack([codes // nodes, codes % nodes], axis=1).astype(np.int32)
