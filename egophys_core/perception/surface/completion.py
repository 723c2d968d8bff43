"""The hidden side of a solid: its visible side turned about the middle.

Ellipsoids, boxes, cylinders and most toys lying on a table are nearly symmetric about a point half way up. The outline
of the visible side runs around that point, so its mean is the middle; the top and the table give its height.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.perception.surface.surface_mesh import SurfaceMesh, boundary_edges

RIM_NEIGHBOURS = 3
"""Points of the other side that each point of the outline is tied to."""


@dataclass(frozen=True, kw_only=True)
class ClosedSurface:
    """Both sides of a solid."""

    positions: np.ndarray
    """[2 V, 3] metres: the visible vertices, then the point opposite each."""
    links: np.ndarray
    """[E, 2] int: edges of both sides, struts through the body and ties around the rim."""


def close_surface(mesh: SurfaceMesh, visible: np.ndarray, table_height: float) -> ClosedSurface:
    """Mirror the visible vertices [V, 3] (metres, frame world) through the middle of the body, down to the table."""
    outline = boundary_edges(mesh.triangles)
    ends = visible[outline]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    middle = np.average(ends.mean(axis=1), axis=0, weights=length)
    middle[2] = (visible[:, 2].max() + table_height) / 2
    opposite = 2 * middle - visible
    opposite[:, 2] = np.maximum(opposite[:, 2], table_height)
    count = len(visible)
    rim = np.unique(outline)
    near = cKDTree(opposite).query(visible[rim], k=RIM_NEIGHBOURS)[1]
    links = np.vstack(
        [
            mesh.edges,
            mesh.edges + count,
            mesh.edges + [0, count],
            mesh.edges[:, ::-1] + [0, count],
            np.column_stack([np.arange(count), np.arange(count) + count]),
            np.column_stack([np.repeat(rim, RIM_NEIGHBOURS), near.ravel() + count]),
        ]
    )
    positions = np.vstack([visible, opposite])
    links = np.unique(np.sort(links, axis=1), axis=0)
    apart = np.linalg.norm(positions[links[:, 0]] - positions[links[:, 1]], axis=1)
    # Two points at one place have no direction in which to keep their distance.
    return ClosedSurface(positions=positions, links=links[apart > 0.1 * np.median(apart)])
