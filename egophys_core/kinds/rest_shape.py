"""The object at rest: node positions before any hand touches it, and what kind of object it is."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

from egophys_core.errors import EpisodeError
from egophys_core.twin import ObjectKind

SHEET_FLATNESS = 0.12
"""Smallest over second largest spread; a sheet lies below this, a toy above."""

FEWEST_POINTS = 4
"""A shape needs a point off the plane of three others or three neighbours to hang on."""


SYMMETRIES = (np.array([-1.0, -1.0, 1.0]), np.array([-1.0, -1.0, -1.0]))
"""Half a turn about a vertical axis, as a toy has that stands upright, and reflection in a point, which ellipsoids and
boxes keep however they lie."""

OUTSIDE = 0.01
"""What a point of the image counts outside of what is seen, where it may be hidden, against inside."""

SYMMETRIC = 0.25
"""Of the spacing: how deep what is seen may come to lie inside of an object that counts as symmetric."""

CENTRES = (0.25, 0.375, 0.5, 0.625, 0.75)
"""Where between the ends of what is seen the search for a centre may begin, along each axis."""

FOOT = 0.3
"""Of the spacing: height above the lowest point up to which an object stands on the table."""


@dataclass(frozen=True, kw_only=True)
class RestShape:
    """Nodes of the object before it is touched."""

    positions: np.ndarray
    """[N, 3] float32, metres, world; surface nodes first."""
    surface: np.ndarray
    """[N] bool."""
    kind: ObjectKind
    spacing: float
    """Median distance of a surface node to its fourth-nearest other one, metres: a grid's spacing, whether
    the points are a grid or strewn at random."""


def rest_shape(
    points: np.ndarray, *, name: str, ground: float, max_nodes: int, kind: ObjectKind | None = None
) -> RestShape:
    """Choose nodes among points [P, 3], metres, of an object at rest.

    Args:
        name: of the episode that shows them.
        ground: world z of the table, metres.
        max_nodes: most surface nodes; more points than that are thinned by farthest-point sampling.
        kind: given by the user, else a flat cloud is a sheet and any other a solid, which is filled inside.

    Raises:
        EpisodeError: fewer than `FEWEST_POINTS` points seen before contact.
    """
    if len(points) < FEWEST_POINTS:
        raise EpisodeError(
            f"{name}: {len(points)} object point(s) seen before the first contact; "
            f"a twin needs at least {FEWEST_POINTS}. Start recording before the hand covers the object"
        )
    points = points[farthest_points(points, max_nodes)]
    points = points[_distinct(points)]
    neighbours = min(5, len(points))
    spacing = float(np.median(cKDTree(points).query(points, k=neighbours)[0][:, -1]))
    kind = kind or _guess_kind(points)
    inside = _interior(points, spacing, ground) if kind == ObjectKind.SOLID else np.zeros((0, 3))
    return RestShape(
        positions=np.concatenate([points, inside]).astype(np.float32),
        surface=np.arange(len(points) + len(inside)) < len(points),
        kind=kind,
        spacing=spacing,
    )


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """Indices of at most `count` points, each the farthest from those before it, in increasing order."""
    if len(points) <= count:
        return np.arange(len(points))
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.sort(np.array(chosen))


def _distinct(points: np.ndarray) -> np.ndarray:
    """Indices without points that coincide with an earlier one (a spring between them has no direction)."""
    repeats = {j for i, j in cKDTree(points).query_pairs(1e-6)}
    return np.array([index for index in range(len(points)) if index not in repeats])


def _guess_kind(points: np.ndarray) -> ObjectKind:
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T)), 0.0))
    return ObjectKind.SHEET if spread[0] < SHEET_FLATNESS * spread[1] else ObjectKind.SOLID


def _interior(points: np.ndarray, spacing: float, ground: float) -> np.ndarray:
    """[I, 3] the nodes of a solid that are not seen: its back, its foot, and what is inside."""
    try:
        shell = np.concatenate([points, _hidden(points, spacing, ground)])
    except QhullError:
        return np.zeros((0, 3))
    lowest = float(shell[:, 2].min())
    rim = shell[shell[:, 2] < lowest + FOOT * spacing]
    foot = _thinned(rim * [1, 1, 0] + [0, 0, lowest], shell, spacing)
    shell = np.concatenate([shell, foot])
    return np.concatenate([shell[len(points) :], _fill(shell, spacing)])


def _thinned(points: np.ndarray, others: np.ndarray, spacing: float) -> np.ndarray:
    """Those at least a spacing apart and away from others."""
    kept = np.zeros((0, 3))
    for point in points:
        near = np.concatenate([others, kept])
        if np.linalg.norm(near - point, axis=1).min() > 0.7 * spacing:
            kept = np.concatenate([kept, point[None]])
    return kept


def _hidden(points: np.ndarray, spacing: float, ground: float) -> np.ndarray:
    """[H, 3] the side a camera does not see, if the object has one of the symmetries toys and boxes have.

    Without its back an object is too light there, falls over where the real one lies still, and hangs askew from a
    hand. An image must not lie inside of what is seen, nor under the table, and no farther outside than it has to; and
    what is seen must not lie inside of both.
    """
    seen = ConvexHull(points)
    hull, hull_points = seen.equations, seen.vertices
    low, high = points.min(axis=0), points.max(axis=0)

    def buried(image: np.ndarray) -> float:
        """Metres a point by which what is seen lies deeper inside of it and the image than inside of itself."""
        whole = ConvexHull(np.concatenate([points[hull_points], image[hull_points]])).equations
        return float((_heights(points, hull) - _heights(points, whole)).mean())

    def best_image(signs: np.ndarray) -> tuple[float, np.ndarray]:
        """The image about the centre that fits best, and its cost, metres a point."""

        def image(centre: np.ndarray) -> np.ndarray:
            return signs * points + (1.0 - signs) * centre

        def cost(centre: np.ndarray) -> float:
            there = image(centre)
            height = _heights(there, hull)
            wrong = np.maximum(-height, 0.0) + np.maximum(ground - there[:, 2], 0.0) + OUTSIDE * np.maximum(height, 0.0)
            return float(wrong.mean()) + buried(there)

        # An image far behind all that is seen lies nowhere inside of it: the search must not begin there.
        shares = np.stack(np.meshgrid(*[CENTRES] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        start = min(low + shares * (high - low), key=cost)
        simplex = start + np.concatenate([np.zeros((1, 3)), spacing * np.eye(3)])
        found = minimize(cost, start, method="Nelder-Mead", options={"initial_simplex": simplex})
        return float(found.fun), image(found.x)

    image = min((best_image(signs) for signs in SYMMETRIES), key=lambda each: each[0])[1]
    if buried(image) > SYMMETRIC * spacing:
        return np.zeros((0, 3))
    hidden: np.ndarray = image[cKDTree(points).query(image)[0] > spacing]
    return hidden


def _heights(points: np.ndarray, hull: np.ndarray) -> np.ndarray:
    """[P] metres by which points [P, 3] lie outside of a convex hull with planes [F, 4], negative inside."""
    return np.asarray((points @ hull[:, :3].T + hull[:, 3]).max(axis=1))


def _fill(points: np.ndarray, spacing: float) -> np.ndarray:
    """Points on a grid inside the convex hull of the surface."""
    try:
        hull = Delaunay(points[ConvexHull(points).vertices])
    except QhullError:
        return np.zeros((0, 3))
    low, high = points.min(axis=0), points.max(axis=0)
    step = 1.2 * spacing
    axes = [np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = grid[hull.find_simplex(grid) >= 0]
    return inside[cKDTree(points).query(inside)[0] > 0.6 * spacing] if len(inside) else inside
