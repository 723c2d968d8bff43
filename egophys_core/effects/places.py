"""Places on an object or in the room: how they are spread for a search, and which nodes belong to one."""

import numpy as np

CORNERS = ((0, 0), (-1, -1), (-1, 1), (1, -1), (1, 1))
"""The centre of a box and its corners."""

HORIZONTAL = (0, 1)
"""Axes along the table."""


def longest_axes(extent: np.ndarray) -> tuple[int, int]:
    """The two axes along which an extent [3] is largest, the larger one first."""
    order = np.argsort(-extent, kind="stable")
    return int(order[0]), int(order[1])


def spread(
    low: np.ndarray,
    high: np.ndarray,
    pattern: tuple[tuple[int, int], ...],
    *,
    extent_share: float,
    axes: tuple[int, int],
) -> np.ndarray:
    """[len(pattern), 3] metres: places in a box, away from its centre by a share of its half extents along two axes."""
    places = np.tile((low + high) / 2, (len(pattern), 1))
    places[:, axes] += extent_share * np.array(pattern) * ((high - low) / 2)[list(axes)]
    return places


def weights_around(positions: np.ndarray, place: np.ndarray, radius: float) -> np.ndarray:
    """[N] Gaussian weights of sum 1 of nodes [N, 3] about a place [3]; of standard deviation `radius`, metres.

    Of a place far from all nodes the nearest ones are taken.
    """
    squared = ((positions - place) ** 2).sum(axis=1)
    weights = np.exp((squared.min() - squared) / (2.0 * radius**2))
    return weights / weights.sum()
