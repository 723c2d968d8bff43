"""The hidden side of a solid: its visible side turned about the middle.

Ellipsoids, boxes, cylinders and most toys lying on a table are nearly symmetric about a point half way up. The outline
of the visible side runs around that point, so its mean is the middle; the top and the table give its height.
"""

from dataclasses import dataclass

import numpy as np

from egophys_core.perception.surface.surface_mesh import SurfaceMesh, boundary_edges


@dataclass(frozen=True, kw_only=True)
class ClosedSurface:
    """Both sides of a solid."""

    positions: np.ndarray
    """[2 V, 3] metres: the visible vertices, then the point opposite each."""
    triangles: np.ndarray
    """[2 F, 3] int: those of both sides, turned alike as seen from outside."""


def close_surface(mesh: SurfaceMesh, visible: np.ndarray, table_height: float) -> ClosedSurface:
    """Mirror the visible vertices [V, 3] (metres, frame world) through the middle of the body, down to the table."""
    outline = boundary_edges(mesh.triangles)
    ends = visible[outline]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    middle = np.average(ends.mean(axis=1), axis=0, weights=length)
    middle[2] = (visible[:, 2].max() + table_height) / 2
    opposite = 2 * middle - visible
    opposite[:, 2] = np.maximum(opposite[:, 2], table_height)
    turned_over = mesh.triangles[:, ::-1] + len(visible)
    return ClosedSurface(positions=np.vstack([visible, opposite]), triangles=np.vstack([mesh.triangles, turned_over]))
