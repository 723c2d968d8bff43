"""An object that lies in its twin's rest shape, wherever that is on the table, from points without known ids."""

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from egophys_core.kinds import kind_of
from egophys_core.observation.problem import ANOTHER_OBJECT, LEAST_APART
from egophys_core.observation.registration import placed
from egophys_core.twin import Twin

FEWEST_POINTS = 20
"""Seen points below which a shape is not told."""
ON_TWIN, COVERED = 0.9, 0.97
"""Share of the seen points that lie on the twin, and of the twin's surface nodes that lie on seen points, where the
object is in the twin's shape: of one that is folded all points lie on the twin, but not the twin on the points."""
YAWS = np.deg2rad(np.arange(-180, 180, 15))
"""Turns about the vertical that are tried."""
REFINED = 3
"""Of these so many are refined, those of the least misfit."""
ALIKE = 1.1
"""Of turns whose misfits are within this factor of the least the smallest is taken: a square looks alike in four."""


def lying_nodes(twin: Twin, points: np.ndarray) -> np.ndarray | None:
    """[N, 3] float32 metres: the nodes at rest, turned and shifted on the table onto points [P, 3]; None if not so."""
    if kind_of(twin.model).from_surface is None or len(points) < FEWEST_POINTS:
        return None
    graph, seen = twin.model.graph, points.astype(np.float64)
    surface = graph.positions[graph.surface].astype(np.float64)
    pose = _pose(surface, seen)
    nodes = placed(graph.positions, pose, surface.mean(axis=0))
    near = max(ANOTHER_OBJECT * float(np.median(graph.rest_lengths)), LEAST_APART)
    tree = cKDTree(seen)
    between_points = float(np.median(tree.query(seen, k=2)[0][:, 1]))
    on_twin = (cKDTree(nodes[graph.surface]).query(seen)[0] <= near).mean()
    covered = (tree.query(nodes[graph.surface])[0] <= near + between_points).mean()
    return nodes if on_twin >= ON_TWIN and covered >= COVERED else None


def _pose(surface: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[4] shift in metres after a turn about the middle of a shape [S, 3], and that turn, that bring it onto points.

    What counts is how far the points stand out of the shape and the shape out of the points, to the fourth power:
    within a sheet the nearest pairs are near wherever it lies, only at its border they tell.
    """
    centre, middle = surface.mean(axis=0), points.mean(axis=0)
    shape, seen = cKDTree(surface), cKDTree(points)
    rise = float(np.median(points[:, 2]) - np.median(surface[:, 2]))

    def pose_of(numbers: np.ndarray) -> np.ndarray:
        return np.array([*(middle - centre)[:2] + numbers[:2], rise, numbers[2]])

    def misfit(numbers: np.ndarray) -> float:
        pose = pose_of(numbers)
        there = placed(surface, pose, centre)
        back = placed(points - pose[:3], np.array([0, 0, 0, -pose[3]]), centre)
        return float((seen.query(there)[0] ** 4).mean() + (shape.query(back)[0] ** 4).mean()) ** 0.25

    tried = sorted((np.array([0.0, 0.0, yaw]) for yaw in YAWS), key=misfit)[:REFINED]
    size = float(np.ptp(points[:, :2], axis=0).max())
    first_steps = np.array([[0, 0, 0], [0.05 * size, 0, 0], [0, 0.05 * size, 0], [0, 0, np.deg2rad(8)]])
    options = {"xatol": 1e-3 * size, "fatol": 1e-3 * size, "maxfev": 150}
    refined = [
        minimize(misfit, start, method="Nelder-Mead", options={**options, "initial_simplex": start + first_steps})
        for start in tried
    ]
    least = min(each.fun for each in refined)
    turns = [each.x for each in refined if each.fun <= ALIKE * least]
    return pose_of(min(turns, key=lambda numbers: abs((numbers[2] + np.pi) % (2 * np.pi) - np.pi)))
