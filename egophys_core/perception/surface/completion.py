"""The hidden side of a solid: its visible side turned about the middle.

Ellipsoids, boxes, cylinders and most toys lying on a table are nearly symmetric about a point half way up. The outline
of the visible side runs around that point, so its mean is the middle; the top and the table give its height. What would
be seen of it, before the visible side or beside it, is drawn towards the middle until it is hidden.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_mesh import SurfaceMesh, boundary_edges
from egophys_core.perception.surface.surface_render import project

BESIDE = 1.5
"""Distances between neighbouring vertices, in the view, within which a point is behind or before one of them."""

STEPS = 20
"""In which a point is drawn to the middle."""


@dataclass(frozen=True, kw_only=True)
class ClosedSurface:
    """Both sides of a solid."""

    positions: np.ndarray
    """[2 V, 3] metres: the visible vertices, then the point opposite each."""
    triangles: np.ndarray
    """[2 F, 3] int: those of both sides, turned alike as seen from outside."""


def close_surface(mesh: SurfaceMesh, visible: np.ndarray, table_height: float, view: View) -> ClosedSurface:
    """Mirror the vertices [V, 3] (metres, frame world) that a view shows through the middle of the body.

    No image lies below the table, nor where the view would show it.
    """
    outline = boundary_edges(mesh.triangles)
    ends = visible[outline]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    middle = np.average(ends.mean(axis=1), axis=0, weights=length)
    middle[2] = (visible[:, 2].max() + table_height) / 2
    opposite = _hidden(2 * middle - visible, middle, visible, view)
    opposite[:, 2] = np.maximum(opposite[:, 2], table_height)
    turned_over = mesh.triangles[:, ::-1] + len(visible)
    return ClosedSurface(positions=np.vstack([visible, opposite]), triangles=np.vstack([mesh.triangles, turned_over]))


def _hidden(points: np.ndarray, middle: np.ndarray, visible: np.ndarray, view: View) -> np.ndarray:
    """Points [V, 3], drawn as far towards the middle [3] as hides each behind the visible vertices [V, 3], metres."""
    shown = project(visible, view.camera_matrix, view.world_from_camera)
    tree = cKDTree(shown[:, :2])
    beside = BESIDE * float(np.median(tree.query(shown[:, :2], k=2)[0][:, 1]))
    found, is_hidden = points.copy(), np.zeros(len(points), bool)
    for share in np.linspace(1.0, 0.0, STEPS + 1):
        there = middle + share * (points[~is_hidden] - middle)
        seen = project(there, view.camera_matrix, view.world_from_camera)
        away, nearest = tree.query(seen[:, :2])
        found[~is_hidden] = there
        is_hidden[~is_hidden] = (away < beside) & (seen[:, 2] >= shown[nearest, 2])
    return found
