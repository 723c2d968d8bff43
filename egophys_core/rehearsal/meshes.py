"""Meshes of soft objects, their surface, and points spread over it."""

import numpy as np
from scipy.spatial import ConvexHull, Delaunay

from egophys_core.geometry import farthest_first

FLAT_TETRAHEDRON = 0.05
"""Volume over longest edge cubed, 1 for a regular tetrahedron, below which an element is left out: it would be
stiff and hold nothing."""

SEAT = 0.7
"""Height of an ellipsoid's middle above its flat seat, over its radius."""


def sheet_mesh(size: np.ndarray, spacing: float = 0.018) -> tuple[np.ndarray, np.ndarray]:
    """A flat sheet of congruent, nearly equilateral triangles, every other row half a triangle aside.

    Squares cut along diagonals that all go one way bend more easily along these: an anisotropic sheet. Where two
    triangles at an edge are no parallelogram, as at a straight side, MuJoCo 3.3 strains a sheet at rest.
    """
    columns, rows = round(size[0] / spacing), round(size[1] / (spacing * np.sqrt(3.0) / 2.0)) + 1
    width = size[0] / (columns + 0.5)
    column, row = np.meshgrid(np.arange(columns + 1), np.arange(rows), indexing="ij")
    along = (column + 0.5 * (row % 2)) * width - 0.5 * size[0]
    across = (row / (rows - 1) - 0.5) * size[1]
    vertices = np.stack([along, across, np.zeros_like(along)], axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(columns + 1, rows)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    even = (row[:-1, :-1] % 2 == 0)[..., None]
    first = np.where(even, np.stack([a, b, d], axis=-1), np.stack([a, b, c], axis=-1))
    second = np.where(even, np.stack([b, c, d], axis=-1), np.stack([a, c, d], axis=-1))
    return vertices, np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


def ellipsoid_mesh(radii: np.ndarray, shells: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Tetrahedra between nested spheres of evenly spread points, scaled, with a flat seat so that it does not roll."""
    points = np.concatenate([np.zeros((1, 3))] + [_sphere(shell) * shell / shells for shell in range(1, shells + 1)])
    # Points on common spheres are degenerate for Delaunay; QJ moves them by a hair.
    elements = Delaunay(points, qhull_options="QJ").simplices
    downward = np.maximum(-points[:, 2] / np.maximum(np.linalg.norm(points, axis=1), 1e-9), SEAT)
    return points * (SEAT / downward)[:, None] * radii, elements


def _sphere(frequency: int) -> np.ndarray:
    """Points of an icosahedron with every edge cut in `frequency` parts, on the unit sphere."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corners = np.array([(0.0, one, two) for one in (-1.0, 1.0) for two in (-golden, golden)])
    corners = np.concatenate([np.roll(corners, shift, axis=1) for shift in range(3)])
    points = [
        (corners[face[0]] * i + corners[face[1]] * j + corners[face[2]] * (frequency - i - j)) / frequency
        for face in ConvexHull(corners).simplices
        for i in range(frequency + 1)
        for j in range(frequency + 1 - i)
    ]
    unique = np.unique(np.round(points, 9), axis=0)
    return unique / np.linalg.norm(unique, axis=1, keepdims=True)


def box_mesh(size: np.ndarray, spacing: float = 0.026) -> tuple[np.ndarray, np.ndarray]:
    """A grid of cubes, each of six tetrahedra around its diagonal (Kuhn's subdivision)."""
    counts = [round(extent / spacing) + 1 for extent in size]
    axes = [np.linspace(-0.5, 0.5, count) * extent for count, extent in zip(counts, size, strict=True)]
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(counts)
    elements = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        corner = np.zeros(3, int)
        path = [corner.copy()]
        for axis in order:
            corner[axis] += 1
            path.append(corner.copy())
        slices = [tuple(slice(at, at + n - 1) for at, n in zip(each, counts, strict=True)) for each in path]
        elements.append(np.stack([index[each].ravel() for each in slices], axis=1))
    return vertices, np.concatenate(elements)


def without_flat(vertices: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Tetrahedra of positive volume, without the flat ones."""
    corners = vertices[elements]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    longest = np.max(np.linalg.norm(corners[:, :, None] - corners[:, None], axis=3), axis=(1, 2))
    elements = np.where((volumes < 0)[:, None], elements[:, [0, 2, 1, 3]], elements)
    return elements[6.0 * np.sqrt(2.0) * np.abs(volumes) > FLAT_TETRAHEDRON * longest**3]


def boundary(elements: np.ndarray) -> np.ndarray:
    """Faces that belong to one tetrahedron only, [F, 3]."""
    faces = np.concatenate([elements[:, list(each)] for each in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))])
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[first[counts == 1]]


def spread_points(triangles: np.ndarray, count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over triangles [F, 3, 3]: of many random ones, always the one farthest from those taken."""
    areas = 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    chosen = random.choice(len(triangles), 10 * count, p=areas / areas.sum())
    weights = random.dirichlet((1.0, 1.0, 1.0), 10 * count)
    places = np.einsum("nk,nkd->nd", weights, triangles[chosen])
    taken = farthest_first(places, count, first=0)
    return chosen[taken], weights[taken]
