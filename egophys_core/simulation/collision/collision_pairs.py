"""Finding the pairs of nodes that may collide within a frame (docs/notes/self_collision.md)."""

from typing import Any

import numpy as np
import warp as wp

from egophys_core.errors import SimulationError
from egophys_core.lanes import Lanes, group_count, pack
from egophys_core.simulation.collision import pair_search
from egophys_core.simulation.collision.pair_search import CLUSTER_SIZE, BoxArrays, ClusterArrays, SearchArrays
from egophys_core.simulation.collision.self_collision import PairArrays


class PairFinder:
    """Finds the pairs that may collide, frame after frame, in K rollouts of one object."""

    def __init__(self, rest_positions: np.ndarray, distances: np.ndarray, device: str) -> None:
        """Group the nodes into clusters.

        Args:
            rest_positions: [N, 3] metres.
            distances: [K] collision distance of each rollout, metres; 0 for no self-collision.
            device: a Warp device.

        Raises:
            SimulationError: a shape or a number is off.
        """
        if rest_positions.ndim != 2 or rest_positions.shape[1] != 3 or not np.isfinite(rest_positions).all():
            raise SimulationError(f"rest positions must be finite [N, 3] metres, got shape {rest_positions.shape}")
        if distances.ndim != 1 or not (np.isfinite(distances) & (distances >= 0)).all():
            raise SimulationError(f"collision distances must be [K] metres, 0 or more, got {distances}")
        self.device, self.nodes, self.groups = device, len(rest_positions), group_count(len(distances))
        members = clusters_of(rest_positions)
        order = np.concatenate(members)
        self.clusters = ClusterArrays()
        self.clusters.nodes = self._array(order, int)
        self.clusters.rest_positions = self._array(rest_positions[order], wp.vec3)
        self.clusters.starts = self._array(np.cumsum([0, *map(len, members)]), int)
        self.rest_positions = self._array(rest_positions, wp.vec3)
        self.shape = (self.groups, len(members))
        self.boxes = BoxArrays()
        self.boxes.centres = wp.empty((*self.shape, 3), dtype=Lanes, device=device)
        self.boxes.halves = wp.empty((*self.shape, 3), dtype=Lanes, device=device)
        self.boxes.velocities = wp.empty((*self.shape, 3), dtype=Lanes, device=device)
        self.boxes.speeds = wp.empty(self.shape, dtype=Lanes, device=device)
        self.search = SearchArrays()
        self.search.distances = self._array(pack(distances), Lanes)
        self.marks = wp.empty((self.groups, self.nodes, len(members)), dtype=wp.uint32, device=device)
        self.counts = wp.empty((self.groups, self.nodes), dtype=int, device=device)

    def find(self, positions: wp.array, velocities: wp.array, horizon: float) -> PairArrays:
        """Pairs that may come nearer than their collision distance within `horizon` seconds, in arrays of their own.

        Args:
            positions: [G, N or more, 3] of Lanes, metres; what comes after the N nodes is left out.
            velocities: likewise, m/s.
            horizon: seconds.
        """
        self.search.horizon = horizon
        state = (positions, velocities)
        self.counts.zero_()
        self._launch(pair_search.bound_clusters, self.shape, self.clusters, *state, self.boxes)
        marked = (self.marks, self.counts)
        self._launch(pair_search.mark_pairs, self.shape, self.clusters, self.boxes, self.search, *state, *marked)
        ends = np.concatenate([[0], np.cumsum(self.counts.numpy())])
        starts = ends[np.arange(self.groups)[:, None] * self.nodes + np.arange(self.nodes + 1)]
        pairs = PairArrays()
        pairs.count = int(ends[-1])
        pairs.starts = self._array(starts, int)
        pairs.others = wp.empty(pairs.count, dtype=int, device=self.device)
        pairs.distances = wp.empty(pairs.count, dtype=Lanes, device=self.device)
        if pairs.count:
            rows = self._array(starts[:, :-1], int)
            self._launch(pair_search.list_pairs, self.shape, self.clusters, self.marks, rows, pairs.others)
            rest = self.rest_positions
            self._launch(pair_search.finish_rows, self.counts.shape, rest, self.search, *state, pairs)
        return pairs

    def _array(self, values: np.ndarray, kind: Any) -> wp.array:
        return wp.array(values, dtype=kind, device=self.device)

    def _launch(self, kernel: wp.Kernel, dim: tuple[int, ...], *inputs: Any) -> None:
        # A tape that records the rollout must not see the search: it has no gradient.
        wp.launch(kernel, dim=dim, inputs=list(inputs), device=self.device, record_tape=False)


def find_pairs(
    positions: np.ndarray,
    velocities: np.ndarray,
    *,
    horizon: float,
    distances: np.ndarray,
    rest_positions: np.ndarray,
    device: str,
) -> PairArrays:
    """`PairFinder.find`, once, for a state on the host.

    Args:
        positions: [K, N, 3] metres.
        velocities: [K, N, 3] m/s.
        horizon: seconds.
        distances: [K] metres.
        rest_positions: [N, 3] metres.
        device: a Warp device.

    Raises:
        SimulationError: a shape or a number is off.
    """
    shape = (len(distances), len(rest_positions), 3)
    for label, array in (("positions", positions), ("velocities", velocities)):
        if array.shape != shape:
            raise SimulationError(f"{label} must be {shape} for these distances and this object, got {array.shape}")
    finder = PairFinder(rest_positions, distances, device)
    here, moving = (wp.array(pack(array), dtype=Lanes, device=device) for array in (positions, velocities))
    return finder.find(here, moving, horizon)


def clusters_of(rest_positions: np.ndarray) -> list[np.ndarray]:
    """Nodes in groups of at most `CLUSTER_SIZE` that lie together: halved across the longest side again and again.

    Args:
        rest_positions: [N, 3] metres.
    """

    def halve(nodes: np.ndarray) -> list[np.ndarray]:
        if len(nodes) <= CLUSTER_SIZE:
            return [nodes]
        points = rest_positions[nodes]
        order = np.argsort(points[:, np.ptp(points, axis=0).argmax()], kind="stable")
        middle = len(nodes) // 2
        return halve(nodes[order[:middle]]) + halve(nodes[order[middle:]])

    return halve(np.arange(len(rest_positions)))
