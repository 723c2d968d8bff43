"""The object at rest: node positions before any hand touches it, and what kind of object it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.identification.contact import Hand
from egophys_core.twin import ObjectKind

SHEET_FLATNESS = 0.12
"""Smallest over second largest spread; a sheet lies below this, a toy above."""

FEWEST_POINTS = 4
"""A shape needs a point off the plane of three others or three neighbours to hang on."""


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


def rest_shape(episode: Episode, hands: Sequence[Hand], *, max_nodes: int, kind: ObjectKind | None = None) -> RestShape:
    """Average the observed points over the frames before contact and choose nodes among them.

    Args:
        max_nodes: most surface nodes; more points than that are thinned by farthest-point sampling.
        kind: given by the user, else a flat cloud is a sheet and any other a solid, which is filled inside.

    Raises:
        EpisodeError: fewer than `FEWEST_POINTS` points seen before contact.
    """
    touched, points = observed_at_rest(episode, hands)
    if len(points) < FEWEST_POINTS:
        raise EpisodeError(
            f"{episode.name}: {len(points)} object point(s) seen before the first contact (frame {touched}); "
            f"a twin needs at least {FEWEST_POINTS}. Start recording before the hand covers the object"
        )
    points = points[farthest_points(points, max_nodes)]
    points = points[_distinct(points)]
    neighbours = min(5, len(points))
    spacing = float(np.median(cKDTree(points).query(points, k=neighbours)[0][:, -1]))
    kind = kind or _guess_kind(points)
    inside = _fill(points, spacing, episode.ground_height) if kind == ObjectKind.SOLID else np.zeros((0, 3))
    return RestShape(
        positions=np.concatenate([points, inside]).astype(np.float32),
        surface=np.arange(len(points) + len(inside)) < len(points),
        kind=kind,
        spacing=spacing,
    )


def observed_at_rest(episode: Episode, hands: Sequence[Hand]) -> tuple[int, np.ndarray]:
    """Frame of the first contact, and [P, 3] metres: mean positions before it of the points seen mostly then."""
    touched = min((hand.first for hand in hands if hand.touches), default=episode.frames)
    still = episode.points[: max(touched, 1)]
    seen_mostly = np.isfinite(still).all(axis=2).mean(axis=0) >= 0.5
    return touched, np.nanmean(still[:, seen_mostly].astype(np.float64), axis=0)


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


def _fill(points: np.ndarray, spacing: float, ground: float) -> np.ndarray:
    """Points on a grid inside the convex hull of the surface and its outline on the table."""
    lowest = points[:, 2] < np.median(points[:, 2])
    footprint = points[lowest] * [1, 1, 0] + [0, 0, min(float(points[:, 2].min()), ground + spacing)]
    shell = np.concatenate([points, footprint])
    try:
        hull = Delaunay(shell[ConvexHull(shell).vertices])
    except QhullError:
        return np.zeros((0, 3))
    low, high = shell.min(axis=0), shell.max(axis=0)
    step = 1.2 * spacing
    axes = [np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = grid[hull.find_simplex(grid) >= 0]
    return inside[cKDTree(points).query(inside)[0] > 0.6 * spacing] if len(inside) else inside
