"""Triangle mesh of the visible surface, made in the image in which it was first seen."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import sparse
from scipy.spatial import Delaunay, QhullError

from egophys_core.errors import EpisodeError

FEWEST_VERTICES = 12
"""With fewer the object is a dozen pixels: nothing can be said of its shape."""


@dataclass(frozen=True, kw_only=True)
class SurfaceMesh:
    """Topology of a surface and its place in the reference image, which is also its texture."""

    pixels: np.ndarray
    """[V, 2] float64, x and y of the vertices in the reference image."""
    triangles: np.ndarray
    """[F, 3] int, counter-clockwise in the reference image as seen (clockwise with y down)."""
    edges: np.ndarray
    """[E, 2] int, each once."""
    hinges: np.ndarray
    """[H, 4] int: the two ends of each inner edge, then the two vertices across it."""


@dataclass(frozen=True, kw_only=True)
class SurfaceTexture:
    """A picture of a surface, and the features that are tracked in it."""

    image: np.ndarray
    """[S, S] uint8: with even contrast."""
    corners: np.ndarray
    """[F, 3, 2]: pixels of the corners of each triangle; NaN for those that it does not show."""
    least_surface: float
    """Share of the patch around a feature that must be surface."""
    first: int
    """Number of its first feature."""
    feature_pixels: np.ndarray
    """[N, 2]: places in the picture."""
    feature_triangles: np.ndarray
    """[N] int."""
    feature_weights: np.ndarray
    """[N, 3]: barycentric coordinates."""

    @property
    def end(self) -> int:
        """Number after that of its last feature."""
        return self.first + len(self.feature_pixels)


def mesh_of_mask(mask: np.ndarray, spacing: float) -> SurfaceMesh:
    """Cover a mask with near-equilateral triangles.

    Args:
        mask: [H, W] bool, one connected region.
        spacing: distance of vertices, pixels.

    Raises:
        EpisodeError: the mask is too small to carry a mesh.
    """
    contour = _boundary(mask, spacing)
    inside = _hexagonal_grid(mask, spacing)
    pixels = np.vstack([contour, inside])
    if len(pixels) < FEWEST_VERTICES:
        raise _too_small(mask)
    try:
        triangles = Delaunay(pixels).simplices
    except QhullError:
        raise _too_small(mask) from None
    centres = pixels[triangles].mean(axis=1)
    corners = pixels[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    columns, rows = np.rint(centres).astype(int).T
    triangles = triangles[mask[rows, columns] & (longest < 2.5 * spacing)]
    triangles = _turn_alike(pixels, triangles)
    if not len(triangles):
        raise _too_small(mask)
    used = np.unique(triangles)
    renumbered = np.full(len(pixels), -1)
    renumbered[used] = np.arange(len(used))
    pixels, triangles = pixels[used], renumbered[triangles]
    edges, hinges = _edges_and_hinges(triangles)
    return SurfaceMesh(pixels=pixels, triangles=triangles, edges=edges, hinges=hinges)


def _too_small(mask: np.ndarray) -> EpisodeError:
    return EpisodeError(
        f"the object covers {int(mask.sum())} pixels of the first view, too few or too thin for a surface; "
        "film it from nearer, or give a box around it"
    )


def locate(mesh: SurfaceMesh, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangle and barycentric coordinates of places in the reference image.

    Args:
        mesh: whose.
        pixels: [N, 2], x and y.

    Returns:
        [N] int, -1 outside the mesh; [N, 3] float64, sum 1.
    """
    triangle = np.full(len(pixels), -1)
    weights = np.zeros((len(pixels), 3))
    a, b, c = (mesh.pixels[mesh.triangles[:, k]] for k in range(3))
    for index, (origin, second, third) in enumerate(zip(a, b, c, strict=True)):
        low = np.minimum(np.minimum(origin, second), third)
        high = np.maximum(np.maximum(origin, second), third)
        near = np.flatnonzero((triangle < 0) & ((pixels >= low) & (pixels <= high)).all(axis=1))
        if len(near):
            rest = np.linalg.solve(np.column_stack([second - origin, third - origin]), (pixels[near] - origin).T).T
            inside = (rest >= -1e-9).all(axis=1) & (rest.sum(axis=1) <= 1 + 1e-9)
            triangle[near[inside]] = index
            weights[near[inside], 1:] = rest[inside]
            weights[near[inside], 0] = 1 - rest[inside].sum(axis=1)
    return triangle, weights


def boundary_edges(triangles: np.ndarray) -> np.ndarray:
    """[B, 2] int: edges that belong to one triangle only."""
    sides = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    return edges[count == 1]


def hinge_gaps(hinges: np.ndarray, places: np.ndarray) -> sparse.csr_matrix:
    """[H, V]: how far the two diagonals of each pair of triangles pass each other; 0 on anything linear.

    The gap of a hinge with ends a, b and c, d across is (1 - s) c + s d - (1 - r) a - r b, where the diagonals cross
    once the pair is laid flat (the quadratic bending of Bergou et al. 2006, up to scale).

    Args:
        hinges: [H, 4] int.
        places: [V, 2] or [V, 3], the shape in which the pairs are laid flat, keeping lengths.
    """
    a, b, c, d = (places[hinges[:, corner]] for corner in range(4))
    along = b - a
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    x, y = np.zeros((2, len(hinges))), np.zeros((2, len(hinges)))
    for side, corner in enumerate((c, d)):
        x[side] = ((corner - a) * along).sum(axis=1) / length
        y[side] = np.sqrt(np.maximum(((corner - a) ** 2).sum(axis=1) - x[side] ** 2, 1e-18))
    share = y[0] / (y[0] + y[1])
    crossing = ((1 - share) * x[0] + share * x[1]) / length
    values = np.column_stack([crossing - 1, -crossing, 1 - share, share])
    rows = np.repeat(np.arange(len(hinges)), 4)
    return sparse.csr_matrix((values.ravel(), (rows, hinges.ravel())), shape=(len(hinges), len(places)))


def vertex_normals(triangles: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """[V, 3] unit normals of vertices at [V, 3], weighted by area; zero where all triangles are flat to nothing."""
    corners = positions[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(positions)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)


def _boundary(mask: np.ndarray, spacing: float) -> np.ndarray:
    """[B, 2] points of the outer contour of a mask, about a spacing apart along it."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.zeros((0, 2))
    contour = max(contours, key=len)[:, 0].astype(float)
    closed = np.vstack([contour, contour[:1]])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1)))
    count = max(int(along[-1] / spacing), 3)
    wanted = np.arange(count) * along[-1] / count
    return np.column_stack([np.interp(wanted, along, closed[:, axis]) for axis in range(2)])


def _hexagonal_grid(mask: np.ndarray, spacing: float) -> np.ndarray:
    """[I, 2] points of a triangular lattice that lie well inside a mask."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return np.zeros((0, 2))
    ys = np.arange(rows.min(), rows.max() + 1, spacing * np.sqrt(0.75))
    xs = np.arange(columns.min(), columns.max() + 1 + spacing, spacing)
    grid = np.array([(x + spacing / 2 * (row % 2), y) for row, y in enumerate(ys) for x in xs])
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    height, width = mask.shape
    inside = (np.rint(grid) < [width, height]).all(axis=1)
    x, y = np.rint(grid[inside]).astype(int).T
    return grid[inside][depth[y, x] > 0.6 * spacing]


def _turn_alike(pixels: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles with positive area in pixel coordinates (y down)."""
    a, b, c = (pixels[triangles[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    turned = np.where(area[:, None] > 0, triangles, triangles[:, ::-1])
    return turned[np.abs(area) > 1e-6]


def _edges_and_hinges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[E, 2] edges, and [H, 4] those with two triangles, with the vertices across."""
    sides = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    across = np.concatenate([triangles[:, 2], triangles[:, 0], triangles[:, 1]])
    edges, which = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    paired = np.flatnonzero(np.diff(which.ravel()[order]) == 0)
    one, other = order[paired], order[paired + 1]
    return edges, np.column_stack([edges[which.ravel()[one]], across[one], across[other]])
