"""Finding the pairs of nodes that may collide within a frame (docs/notes/self_collision.md)."""

from typing import Any

import numpy as np
import warp as wp

from egophys_core.errors import SimulationError
from egophys_core.lanes import Lanes, group_count, pack
from egophys_core.simulation.collision import pair_search
from egophys_core.simulation.collision.pair_search import CLUSTER_SIZE, BoxArrays, ClusterArrays, SearchArrays
from egophys_core.simulation.collision.self_collision import PairArrays
from egophys_core.simulation.host_access import HostAccess
from egophys_core.simulation.recorded_launch import RecordedLaunch


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
        self.search = self._search(self._array(pack(distances), Lanes), 0.0)
        self.marks = wp.empty((self.groups, self.nodes, len(members)), dtype=wp.uint32, device=device)
        each_node = (self.groups, self.nodes)
        self.counts, self.ends = (wp.zeros(each_node, dtype=int, device=device) for _ in range(2))
        self.starts = wp.zeros((self.groups, self.nodes + 1), dtype=int, device=device)
        self.pairs = self._room_for(1)
        """Those that the last search found, in arrays that stay the same until they are too small."""
        self._counts, self._ends, self._starts = map(HostAccess, (self.counts, self.ends, self.starts))
        self._bound, self._mark, self._list = (
            RecordedLaunch(kernel, self.shape, device)
            for kernel in (pair_search.bound_clusters, pair_search.mark_pairs, pair_search.list_pairs)
        )
        self._finish = RecordedLaunch(pair_search.finish_rows, each_node, device)

    def find(self, positions: wp.array, velocities: wp.array, horizon: float) -> bool:
        """Put the pairs that may come nearer than their collision distance within `horizon` seconds into `pairs`.

        Args:
            positions: [G, N or more, 3] of Lanes, metres; what comes after the N nodes is left out.
            velocities: likewise, m/s.
            horizon: seconds.

        Returns:
            Whether there are any.
        """
        if horizon != self.search.horizon:
            self.search = self._search(self.search.distances, horizon)
        state = (positions, velocities)
        self._counts.write(np.zeros(self.counts.shape, np.int32))
        self._bound(self.clusters, *state, self.boxes)
        self._mark(self.clusters, self.boxes, self.search, *state, self.marks, self.counts)
        ends = np.concatenate([[0], np.cumsum(self._counts.read())])
        starts = ends[np.arange(self.groups)[:, None] * self.nodes + np.arange(self.nodes + 1)]
        self._starts.write(starts)
        if ends[-1] > self.pairs.count:
            self.pairs = self._room_for(2 * int(ends[-1]))
        if ends[-1]:
            self._ends.write(starts[:, :-1])
            self._list(self.clusters, self.marks, self.ends, self.pairs.others)
            self._finish(self.rest_positions, self.search, *state, self.pairs)
        return bool(ends[-1])

    def _search(self, distances: wp.array, horizon: float) -> SearchArrays:
        search = SearchArrays()
        search.distances, search.horizon = distances, horizon
        return search

    def _room_for(self, count: int) -> PairArrays:
        pairs = PairArrays()
        pairs.count, pairs.starts = count, self.starts
        pairs.others = wp.zeros(count, dtype=int, device=self.device)
        pairs.distances = wp.zeros(count, dtype=Lanes, device=self.device)
        return pairs

    def _array(self, values: np.ndarray, kind: Any) -> wp.array:
        return wp.array(values, dtype=kind, device=self.device)


def find_pairs(
    positions: np.ndarray,
    velocities: np.ndarray,
    *,
    horizon: float,
    distances: np.ndarray,
    rest_positions: np.ndarray,
    device: str,
) -> PairArrays:
    """What `PairFinder` finds in a state on the host.

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
    finder.find(here, moving, horizon)
    return finder.pairs


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
