"""Triangles between the nodes of an object, to draw its surface."""

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from egophys_core.geometry import spacing

LONGEST_EDGE = 2.5
"""Times the spacing of the nodes: longer edges bridge gaps."""

OFF_GRID = 1e-3
"""Times the spacing by which nodes are moved, to say which are neighbours."""

MOST_NEIGHBOURS = 13
"""Of a node, among which those across it are."""

FEWEST = 4
"""Nodes of a body."""

CORNERS = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
"""Of a tetrahedron of positive volume the faces across from its nodes, seen from outside against the clock."""


def faces_of_sheet(positions: np.ndarray) -> np.ndarray:
    """[F, 3] int32: a Delaunay triangulation of nodes [N, 3] in the plane that they lie nearest to."""
    centred = positions.astype(np.float64) - positions.mean(axis=0)
    across = np.linalg.svd(centred, full_matrices=False)[2]
    try:
        triangles = Delaunay(centred @ across[:2].T).simplices
    except (QhullError, ValueError):
        return np.zeros((0, 3), np.int32)
    return np.asarray(triangles[_near(positions, triangles)], np.int32)


def nodes_across(positions: np.ndarray) -> np.ndarray:
    """[N, 4] int32: for each node [N, 3] of a sheet its neighbours behind and ahead of it along two axes of the plane
    that the nodes lie nearest to; itself where the sheet ends."""
    centred = positions.astype(np.float64) - positions.mean(axis=0)
    flat = centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    near = cKDTree(flat).query(flat, k=min(MOST_NEIGHBOURS, len(flat)))[1]
    steps = flat[near] - flat[:, None]
    lengths = np.maximum(np.linalg.norm(steps, axis=2), 1e-12)
    found = []
    for direction in np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]]):
        along = steps @ direction
        # The nearest of those that lie more along the axis than beside it.
        reach = np.where(along > lengths / np.sqrt(2.0) - 1e-9, lengths, np.inf)
        reach[:, 0] = np.where(np.isinf(reach[:, 1:]).all(axis=1), 0.0, np.inf)
        found.append(near[np.arange(len(near)), reach.argmin(axis=1)])
    return np.stack(found, axis=1).astype(np.int32)


def faces_of_body(positions: np.ndarray) -> np.ndarray:
    """[F, 3] int32: the boundary of the tetrahedra between near nodes [N, 3], seen from outside against the clock."""
    if len(positions) < FEWEST:
        return np.zeros((0, 3), np.int32)
    # On a grid many tetrahedra have no volume, and no side that is outside.
    shaken = positions + OFF_GRID * spacing(positions) * np.random.default_rng(0).uniform(-1.0, 1.0, positions.shape)
    solids = Delaunay(shaken).simplices
    solids = solids[_near(positions, solids)]
    edges = shaken[solids[:, 1:]] - shaken[solids[:, :1]]
    left = np.linalg.det(edges) < 0.0
    solids[left] = solids[left][:, [0, 2, 1, 3]]
    faces = np.concatenate([solids[:, corners] for corners in CORNERS])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(faces[np.sort(first[count == 1])], np.int32)


def _near(positions: np.ndarray, simplices: np.ndarray) -> np.ndarray:
    """[S] bool: simplices [S, D] that have no long edge."""
    corners = positions[simplices]
    longest = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=3).max(axis=(1, 2))
    return np.asarray(longest <= LONGEST_EDGE * spacing(positions))
