"""The object at rest: node positions before any hand touches it, and what kind of object it is."""

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.geometry import farthest_points, spacing
from egophys_core.kinds import KINDS, Kind, kind_named
from egophys_core.kinds.kind import FromSurface, RestShape

FEWEST_POINTS = 4
"""A shape needs a point off the plane of three others or three neighbours to hang on."""


def rest_shape(points: np.ndarray, *, name: str, ground: float, max_nodes: int, kind: str | None = None) -> RestShape:
    """Choose nodes among points [P, 3], metres, of an object at rest.

    Args:
        name: of the episode that shows them.
        ground: world z of the table, metres.
        max_nodes: most surface nodes; more points than that are thinned by farthest-point sampling.
        kind: name of one, given by the user; by default the first that knows the points.

    Raises:
        EpisodeError: fewer than `FEWEST_POINTS` points seen before contact.
        OptionsError: a kind that is not modelled from what is seen of its surface.
    """
    if len(points) < FEWEST_POINTS:
        raise EpisodeError(
            f"{name}: {len(points)} object point(s) seen before the first contact; "
            f"a twin needs at least {FEWEST_POINTS}. Start recording before the hand covers the object"
        )
    points = points[farthest_points(points, max_nodes)]
    points = points[_distinct(points)]
    apart = spacing(points)
    taken = kind_named(kind) if kind else recognised(points)
    inside = surface_model(taken).inside(points, apart, ground)
    return RestShape(
        positions=np.concatenate([points, inside]).astype(np.float32),
        surface=np.arange(len(points) + len(inside)) < len(points),
        kind=taken.name,
        spacing=apart,
    )


def recognised(points: np.ndarray) -> Kind:
    """The first kind that knows points at rest [P, 3] when it sees them."""
    return next(kind for kind in KINDS.values() if kind.from_surface and kind.from_surface.recognises(points))


def surface_model(kind: Kind) -> FromSurface:
    """How a kind is modelled from what is seen of its surface.

    Raises:
        OptionsError: it is not.
    """
    if kind.from_surface is None:
        others = ", ".join(each.name for each in KINDS.values() if each.from_surface)
        raise OptionsError(
            f"a {kind.name} is modelled from markers on it; what is seen all over is one of {others}: choose one of "
            "these, or leave the kind out"
        )
    return kind.from_surface


def _distinct(points: np.ndarray) -> np.ndarray:
    """Indices without points that coincide with an earlier one (a spring between them has no direction)."""
    repeats = {j for i, j in cKDTree(points).query_pairs(1e-6)}
    return np.array([index for index in range(len(points)) if index not in repeats])
