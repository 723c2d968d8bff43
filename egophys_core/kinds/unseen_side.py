"""What is not seen of a solid: its back, its foot, and what is inside."""

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

SYMMETRIES = (np.array([-1.0, -1.0, 1.0]), np.array([-1.0, -1.0, -1.0]))
"""Half a turn about a vertical axis, as a toy has that stands upright, and reflection in a point, which ellipsoids and
boxes keep however they lie."""

OUTSIDE = 0.01
"""What a point of the image counts outside of what is seen, where it may be hidden, against inside."""

SYMMETRIC = 0.25
"""Of the spacing: how deep what is seen may come to lie inside of an object that counts as symmetric."""

ALIKE = 2.0
"""A symmetry counts beside the best one if its image fits at most so many times as badly."""

CENTRES = (0.25, 0.375, 0.5, 0.625, 0.75)
"""Where between the ends of what is seen the search for a centre may begin, along each axis."""

CLOSED, NEAR = 0.96, 1.5
"""Share of the hull, but for the foot, within so many spacings of a point from which on no side counts as hidden: 0.82
to 0.92 of what one camera sees of a solid, 0.99 and more of one whose hidden side was inferred already."""

SAMPLES = 2000
"""Places on the hull that tell it."""

FOOT = 0.3
"""Of the spacing: height above the lowest point up to which an object stands on the table."""


def inside_of(points: np.ndarray, spacing: float, ground: float) -> np.ndarray:
    """[I, 3] the nodes of a solid that are not seen, of points [P, 3], their spacing and the table's height, metres."""
    try:
        shell = np.concatenate([points, _hidden(points, spacing, ground)])
    except QhullError:
        return np.zeros((0, 3))
    lowest = float(shell[:, 2].min())
    stands = shell[:, 2] < lowest + FOOT * spacing
    # It lies still on what it stands on, which is flat; on the nodes of a round foot it would rock.
    shell[len(points) :][stands[len(points) :], 2] = lowest
    foot = _thinned(shell[stands] * [1, 1, 0] + [0, 0, lowest], shell, spacing)
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
    if _is_closed(points, seen, spacing):
        return np.zeros((0, 3))
    hull, hull_points = seen.equations, seen.vertices
    low, high = points.min(axis=0), points.max(axis=0)

    def buried(image: np.ndarray) -> float:
        """Metres a point by which what is seen lies deeper inside of it and the image than inside of itself."""
        whole = ConvexHull(np.concatenate([points[hull_points], image[hull_points]])).equations
        return float((_heights(points, hull) - _heights(points, whole)).mean())

    def best_centre(signs: np.ndarray) -> tuple[float, np.ndarray]:
        """The centre [3] about which the image fits best, and its cost, metres a point."""

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
        return float(found.fun), found.x

    found = [(signs, *best_centre(signs)) for signs in SYMMETRIES]
    least = min(cost for _, cost, _ in found)
    shell = points
    for signs, cost, centre in found:
        image = signs * points + (1.0 - signs) * centre
        if cost <= ALIKE * least and buried(image) <= SYMMETRIC * spacing:
            # What has two symmetries has their product as well.
            shell = np.concatenate([shell, signs * shell + (1.0 - signs) * centre])
    hidden = shell[len(points) :]
    hidden[:, 2] = np.maximum(hidden[:, 2], ground)
    hidden = hidden[cKDTree(points).query(hidden)[0] > spacing]
    return _thinned(hidden, points, spacing)


def _is_closed(points: np.ndarray, hull: ConvexHull, spacing: float) -> bool:
    """Whether points [P, 3] lie all around an object, but for its foot. Images of that would lie beside it."""
    corners = points[hull.simplices]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    generator = np.random.default_rng(0)
    chosen = corners[generator.choice(len(corners), SAMPLES, p=area / area.sum())]
    places = np.einsum("sk,skd->sd", generator.dirichlet(np.ones(3), SAMPLES), chosen)
    places = places[places[:, 2] > points[:, 2].min() + FOOT * spacing]
    return bool((cKDTree(points).query(places)[0] < NEAR * spacing).mean() > CLOSED)


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
