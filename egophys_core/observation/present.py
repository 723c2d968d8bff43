"""The object as it is now: points bound to a twin while its shape is known, and its shape from them afterwards.

docs/notes/present_state.md says what was measured and where this ends.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix, vstack

from egophys_core.errors import EpisodeError
from egophys_core.observation.lying import FEWEST_POINTS, lying_nodes
from egophys_core.observation.nodes_from_points import nodes_from_points
from egophys_core.observation.track_weights import track_weights
from egophys_core.twin import Twin

SAME_IDS = 0.5
"""Share of the seen points that are known by their ids, below which ids were given anew."""
STILL_M = 0.006
"""Median displacement, metres, up to which an object is at rest, beside the noise of its points."""
MISFIT_M = 0.01
"""Median distance, metres, of known points from the best shape, above which they are not those that were known."""


@dataclass(frozen=True, kw_only=True)
class BoundPoints:
    """Points that are known by their ids: where on the twin each is."""

    ids: np.ndarray
    """[P] uint32, increasing."""
    weights: csr_matrix
    """[P, N]: each is this mean of nodes."""
    nodes: np.ndarray
    """[N, 3] float32 metres, where the twin lay when they were bound."""


@dataclass(frozen=True, kw_only=True)
class SeenObject:
    """One observation, and what earlier ones taught."""

    ids: np.ndarray
    """[P] uint32, increasing."""
    points: np.ndarray
    """[P, 3] float32 metres, world, finite."""
    bound: BoundPoints | None
    """None where the object was never seen in a shape that the twin knows."""

    def known(self) -> np.ndarray:
        """[P] bool: whether a point is bound."""
        return np.zeros(len(self.ids), bool) if self.bound is None else np.isin(self.ids, self.bound.ids)


def with_new_points(twin: Twin, seen: SeenObject) -> BoundPoints | None:
    """What is known after an observation: points are bound while the object lies in the twin's rest shape, anywhere.

    Points that appear later are bound as long as it still lies there; where ids were given anew, all of them are.
    """
    known, bound = seen.known(), seen.bound
    if bound is None or known.mean() < SAME_IDS:
        nodes = lying_nodes(twin, seen.points)
        return bound if nodes is None else _bind(twin, nodes, seen.ids, seen.points)
    if known.all():
        return bound
    there = bound.weights[np.searchsorted(bound.ids, seen.ids[known])] @ bound.nodes
    # Where half of a sheet is folded over, the other half lies there still.
    if np.quantile(np.linalg.norm(there - seen.points[known], axis=1), 0.9) > MISFIT_M:
        return bound
    new = _bind(twin, bound.nodes, seen.ids[~known], seen.points[~known])
    order = np.argsort(ids := np.concatenate([bound.ids, new.ids]))
    return BoundPoints(ids=ids[order], weights=vstack([bound.weights, new.weights]).tocsr()[order], nodes=bound.nodes)


def present_nodes(twin: Twin, seen: SeenObject) -> np.ndarray:
    """[N, 3] float32 metres: where the twin's nodes are, by its known points or, in its rest shape, by registration.

    Raises:
        EpisodeError: too little is seen, or the shape cannot be told, and what to do.
    """
    if len(seen.ids) < FEWEST_POINTS:
        raise EpisodeError(
            f"only {len(seen.ids)} points of the object are seen, {FEWEST_POINTS} are needed to tell its shape; show "
            "it to the camera"
        )
    known = seen.known()
    if seen.bound is not None and known.sum() >= FEWEST_POINTS:
        weights, points = seen.bound.weights[np.searchsorted(seen.bound.ids, seen.ids[known])], seen.points[known]
        nodes = nodes_from_points(twin.model.graph, weights, points, floor=float(seen.bound.nodes[:, 2].min()))
        if np.median(np.linalg.norm(weights @ nodes - points, axis=1)) <= MISFIT_M:
            return nodes
    lying = lying_nodes(twin, seen.points)
    if lying is None:
        raise EpisodeError(
            f"the object is not in the shape that twin {twin.twin_id} has at rest, and its points are not known by "
            "their ids: its observer was started or reset since, or it shows another object. Lay it down as it lay "
            "for the twin for a second, or plan from the twin's own shape (start: twin)"
        )
    return lying


def require_at_rest(before: SeenObject, now: SeenObject) -> None:
    """Check that points seen in two observations have not moved.

    Raises:
        EpisodeError: they have.
    """
    both, one, other = np.intersect1d(before.ids, now.ids, assume_unique=True, return_indices=True)
    if len(both) == 0:
        return
    moved = float(np.median(np.linalg.norm(before.points[one] - now.points[other], axis=1)))
    if moved > STILL_M:
        raise EpisodeError(f"the object moves, by {1e3 * moved:.0f} mm in half a second; wait until it is at rest")


def _bind(twin: Twin, nodes: np.ndarray, ids: np.ndarray, points: np.ndarray) -> BoundPoints:
    surface = np.flatnonzero(twin.model.graph.surface)
    weights = track_weights(points.astype(np.float64), nodes.astype(np.float64), surface)
    return BoundPoints(ids=ids, weights=weights, nodes=nodes)
