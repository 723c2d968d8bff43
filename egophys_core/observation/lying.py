"""An object that lies in its twin's rest shape, wherever that is on the table, from points without known ids."""

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from egophys_core.geometry import spacing
from egophys_core.kinds import kind_of
from egophys_core.observation.registration import placed
from egophys_core.twin import Twin

FEWEST_POINTS = 20
"""Seen points below which a shape is not told."""
COVERED = 0.97
"""Share of the points, and of the twin's surface nodes, that lie no farther from the others than these lie apart, where
the object is in the twin's shape. Of one that is folded all points lie on the twin, but not the twin on the points."""
BETWEEN = 1.25
"""Times the median distance to the fourth neighbour: what lies between points strewn at random, at their border too."""
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
    there = nodes[graph.surface]
    return nodes if min(_covered(seen, there), _covered(there, seen)) >= COVERED else None


def _covered(points: np.ndarray, by: np.ndarray) -> float:
    """Share of points [P, 3] no farther from others [Q, 3] than these lie apart at random."""
    return float((cKDTree(by).query(points)[0] <= BETWEEN * spacing(by)).mean())


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
