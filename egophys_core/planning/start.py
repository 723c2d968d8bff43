"""Where the object lies and is taken hold of when a plan begins."""

from dataclasses import dataclass

import numpy as np

from egophys_core.errors import PlanningError
from egophys_core.observation.track_weights import track_weights
from egophys_core.planning.grasp import grasp_from_points
from egophys_core.twin import Twin


@dataclass(frozen=True, kw_only=True)
class Start:
    """The state that plans are rolled out from, at rest."""

    nodes: np.ndarray
    """[N, 3] float32, all nodes of the twin, metres, world."""
    grasp: np.ndarray
    """[C, 3] float32, the points that move with the tool once it has closed, metres, world."""

    def surface(self, twin: Twin) -> np.ndarray:
        """[S, 3] metres: what can be seen of it."""
        return self.nodes[twin.model.graph.surface]


def start_of_twin(twin: Twin) -> Start:
    """As the twin was built: its rest shape, held as the hand held it."""
    return Start(nodes=twin.model.graph.positions, grasp=twin.grasp)


def require_start(start: Start, twin: Twin) -> None:
    """Check that rollouts of a twin can begin there.

    Raises:
        PlanningError: another number of nodes, or not finite.
    """
    wanted = twin.model.graph.positions.shape
    if start.nodes.shape != wanted:
        raise PlanningError(f"the start must be all {wanted[0]} nodes of twin {twin.twin_id}, got {start.nodes.shape}")
    if not (np.isfinite(start.nodes).all() and np.isfinite(start.grasp).all()):
        raise PlanningError("the start must be finite: some of its nodes or points of the grasp are not")


def carried_start(twin: Twin, nodes: np.ndarray) -> Start:
    """The start with the object's nodes at [N, 3] metres, where the tool takes hold of the same material.

    The points of the grasp keep their places about the tool, which always points down; they go where the place on the
    object goes that is in their middle.

    Raises:
        PlanningError: the twin has no grasp.
    """
    graph = twin.model.graph
    middle = grasp_from_points(twin.grasp).position
    weights = track_weights(middle[None], graph.positions.astype(np.float64), np.flatnonzero(graph.surface))
    shift = (weights @ (nodes.astype(np.float64) - graph.positions))[0]
    return Start(nodes=nodes.astype(np.float32), grasp=(twin.grasp + shift).astype(np.float32))
