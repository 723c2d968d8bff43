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
"""Share of the hull, but for the foot, within so many spacings of a point from which on points lie all around: 0.82
to 0.92 of what one camera sees of a solid, 0.99 and more of one whose hidden side was inferred already. What is seen
all around, if sparsely at the back, is only rounded out: no image may lie farther outside than that (right ones lie up
to 1.04 spacings outside, wrong ones beside it 5.7 and more), and its hull gets nodes wherever there are none."""

SAMPLES = 2000
"""Places on a hull that stand for all of it."""

FOOT = 0.3
"""Of the spacing: height above the lowest point up to which an object stands on the table."""

FEET = (FOOT, 0.6, 0.9)
"""The same where its middle would not be above what it stands on: the least is taken with which it is."""

ABOVE = 0.5
"""Of the spacing: how far inside of its foot the middle of what stands is at least."""


def inside_of(points: np.ndarray, spacing: float, ground: float) -> np.ndarray:
    """[I, 3] the nodes of a solid that are not seen, of points [P, 3], their spacing and the table's height, metres."""
    try:
        closed = _is_closed(points, spacing)
        farthest = NEAR * spacing if closed else np.inf
        shell = np.concatenate([points, _hidden(points, spacing, ground, farthest)])
    except QhullError:
        return np.zeros((0, 3))
    lowest = float(shell[:, 2].min())
    stands = _stands(shell, spacing)
    # It lies still on what it stands on, which is flat; on the nodes of a round foot it would rock.
    shell[len(points) :][stands[len(points) :], 2] = lowest
    foot = _thinned(shell[stands] * [1, 1, 0] + [0, 0, lowest], shell, spacing)
    shell = np.concatenate([shell, foot])
    if closed:
        # Nodes are of equal mass: at a back of which little is seen it would be too light.
        shell = np.concatenate([shell, _thinned(_on_hull(shell), shell, spacing)])
    return np.concatenate([shell[len(points) :], _fill(shell, spacing)])


def _stands(shell: np.ndarray, spacing: float) -> np.ndarray:
    """[P] bool, which points of a shell [P, 3] stand on the table: it lies still, so its middle is above them."""
    heights = shell[:, 2] - shell[:, 2].min()
    middle = np.concatenate([shell, _fill(shell, spacing)]).mean(axis=0)
    for share in FEET:
        stands = heights < share * spacing
        if _is_above(middle[:2], shell[stands, :2], ABOVE * spacing):
            break
    return np.asarray(stands)


def _is_above(middle: np.ndarray, foot: np.ndarray, inside: float) -> bool:
    """Whether a place [2] lies at least so far inside of the hull of others [P, 2], metres."""
    try:
        edges = ConvexHull(foot).equations
    except (QhullError, ValueError):
        return False
    return bool(_heights(middle[None], edges)[0] <= -inside)


def _thinned(points: np.ndarray, others: np.ndarray, spacing: float) -> np.ndarray:
    """Those at least a spacing apart and away from others."""
    kept = np.zeros((0, 3))
    for point in points:
        near = np.concatenate([others, kept])
        if np.linalg.norm(near - point, axis=1).min() > 0.7 * spacing:
            kept = np.concatenate([kept, point[None]])
    return kept


def _hidden(points: np.ndarray, spacing: float, ground: float, farthest: float) -> np.ndarray:
    """[H, 3] the side a camera does not see, if the object has one of the symmetries toys and boxes have.

    Without its back an object is too light there, falls over where the real one lies still, and hangs askew from a
    hand. An image must not lie inside of what is seen, nor under the table, and no farther outside than it has to, at
    most `farthest` metres; and what is seen must not lie inside of both.
    """
    seen = ConvexHull(points)
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
        fits = buried(image) <= SYMMETRIC * spacing and _heights(image, hull).max() <= farthest
        if cost <= ALIKE * least and fits:
            # What has two symmetries has their product as well.
            shell = np.concatenate([shell, signs * shell + (1.0 - signs) * centre])
    hidden = shell[len(points) :]
    hidden[:, 2] = np.maximum(hidden[:, 2], ground)
    hidden = hidden[cKDTree(points).query(hidden)[0] > spacing]
    return _thinned(hidden, points, spacing)


def _is_closed(points: np.ndarray, spacing: float) -> bool:
    """Whether points [P, 3] lie all around an object, but for its foot."""
    places = _on_hull(points)
    places = places[places[:, 2] > points[:, 2].min() + FOOT * spacing]
    return bool((cKDTree(points).query(places)[0] < NEAR * spacing).mean() > CLOSED)


def _on_hull(points: np.ndarray) -> np.ndarray:
    """[SAMPLES, 3] places all over the hull of points [P, 3], the same ones each time."""
    corners = points[ConvexHull(points).simplices]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    generator = np.random.default_rng(0)
    chosen = corners[generator.choice(len(corners), SAMPLES, p=area / area.sum())]
    return np.einsum("sk,skd->sd", generator.dirichlet(np.ones(3), SAMPLES), chosen)


def _heights(points: np.ndarray, hull: np.ndarray) -> np.ndarray:
    """[P] metres by which points [P, D] lie outside of a convex hull with facets [F, D + 1], negative inside."""
    return np.asarray((points @ hull[:, :-1].T + hull[:, -1]).max(axis=1))


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
