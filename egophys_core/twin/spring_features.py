"""What a stiffness prior is asked with: features of a spring in its graph, and of how it is deformed."""

import numpy as np

from egophys_core.errors import TwinError
from egophys_core.twin.graph import SpringGraph, SpringKind

STATIC = (
    "rest length",
    "inverse rest length",
    "fewer neighbours",
    "more neighbours",
    "bending",
    "place along 1",
    "place along 2",
    "place along 3",
    "direction along 1",
    "direction along 2",
    "flatness",
    "surface",
)
"""Of the graph alone: metres; 1/m; springs at the end that has fewer, and at the other; whether it is a bending spring;
how far its middle is from the object's along the object's longest, middle and shortest axis, over the half extent;
cosine of its angle to the first two; shortest over longest extent; the share of its ends that are on the surface."""

DYNAMIC = ("log stretch", "strain size", "strain rate", "vertical", "height", "held")
"""Of the rollout: ln(l / l0); |l / l0 - 1|; rate of the strain, 1/s; |cosine| of its angle to the vertical; height of
its middle above where a node touches the table, metres; whether a hand holds an end of it."""

FEATURES = (*STATIC, *DYNAMIC)

SMALLEST_EXTENT = 1e-3
"""Metres. Guards the division by the extent of a sheet along its normal."""


def static_features(graph: SpringGraph) -> np.ndarray:
    """[E, S] float32: the features `STATIC` of every spring. They do not change if the object is moved or turned.

    Raises:
        TwinError: a feature is not finite; says of which spring.
    """
    positions = graph.positions.astype(np.float64)
    first, second = graph.springs.T
    offset = positions - positions.mean(axis=0)
    axes = np.linalg.eigh(np.cov(offset.T, bias=True))[1][:, ::-1]
    places = offset @ axes
    middle = (places.max(axis=0) + places.min(axis=0)) / 2.0
    half = np.maximum(np.ptp(places, axis=0) / 2.0, SMALLEST_EXTENT)
    along = places[second] - places[first]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), SMALLEST_EXTENT)
    between = np.abs((places[first] + places[second]) / 2.0 - middle) / half
    degrees = np.bincount(graph.springs.ravel(), minlength=len(positions))
    rest = graph.rest_lengths.astype(np.float64)
    ends = degrees[graph.springs]
    found = np.column_stack(
        [
            rest,
            1.0 / rest,
            ends.min(axis=1),
            ends.max(axis=1),
            graph.kinds == SpringKind.BENDING,
            between,
            np.abs(along[:, :2]),
            np.full(len(rest), half[2] / half[0]),
            graph.surface[graph.springs].mean(axis=1),
        ]
    ).astype(np.float32)
    if not np.isfinite(found).all():
        spring, feature = np.argwhere(~np.isfinite(found))[0]
        raise TwinError(f"feature {STATIC[feature]} of spring {spring} is not finite; check the object's positions")
    return found
