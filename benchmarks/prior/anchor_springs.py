"""The springs of Spring-Gaus between its volume anchors, and how stiff an anchor makes them.

Zhong, Yu, Wu, Li, "Reconstruction and Simulation of Elastic Objects with Spring-Mass 3D Gaussians", ECCV 2024, and the
code its authors published. An anchor i has a stiffness K_i, a force in newtons, and asks for its nearest anchors; a
soft vector s in one number h lets go of the farther of these. It is pulled to the anchor of rank r among them by

    K_i s_r / l0 * (l - l0) + z / l0 * (rate of l),
    s_r = clamp(2 - e(h)^x, 0, 1),   e(h) = exp(softplus(h)),   x = (r - F) / (n - F),   s_r = 1 for r < F,

the nearest F of n always at full strength. There anchor j feels nothing of what i asked for, so that forces do not
cancel. Ours do: a spring between i and j has half of what each of the two asks of it, the symmetric part of their law.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.simulation.terms.springs import SHORTEST_LENGTH
from egophys_core.twin import SpringGraph, SpringKind

FIXED = 16
"""Of an anchor's neighbours: those that no soft vector lets go of, F."""

NEIGHBOUR_SHARE = 256 / 2048
"""Its anchors ask for 256 of 2048: an eighth of the body. Ours are fewer, and ask for as large a part of it."""


@dataclass(frozen=True, kw_only=True)
class AnchorSprings:
    """Springs between anchors."""

    pairs: np.ndarray
    """[E, 2] int32, anchors i < j, in order."""
    rest_lengths: np.ndarray
    """[E] metres."""
    ranks: np.ndarray
    """[E, 2] int: how many neighbours of the pair's first anchor are nearer than the second, and the other way round;
    -1 where it does not ask for it."""
    neighbours: int
    """That each anchor asks for, n."""

    @property
    def asks(self) -> np.ndarray:
        """[E] half of the number of anchors that ask for a spring: 0.5 or 1."""
        return np.asarray((self.ranks >= 0).mean(axis=1))

    def stiffness(self, anchors: np.ndarray, softness: float) -> np.ndarray:
        """[E] N/m of springs between anchors of stiffness [N], newtons, at a soft vector of this h."""
        return np.asarray((self._weights(softness) * anchors[self.pairs]).sum(axis=1) / self.rest_lengths)

    def damping(self, dashpot: float) -> np.ndarray:
        """[E] N s/m of springs at z, N s."""
        return self.asks * dashpot / self.rest_lengths

    def to_anchors(self, by_stiffness: np.ndarray, anchors: np.ndarray, softness: float) -> tuple[np.ndarray, float]:
        """From derivatives [E] by the stiffness of springs: [N] those by the anchors' stiffness, and that by h."""
        by_force = by_stiffness / self.rest_lengths
        found = np.zeros(len(anchors))
        np.add.at(found, self.pairs, self._weights(softness) * by_force[:, None])
        slopes = np.where(self.ranks >= 0, 0.5 * soft_vector_slope(softness, self.neighbours)[self.ranks], 0.0)
        return found, float((slopes * anchors[self.pairs] * by_force[:, None]).sum())

    def _weights(self, softness: float) -> np.ndarray:
        """[E, 2] of what each end of a spring asks for."""
        return np.where(self.ranks >= 0, 0.5 * soft_vector(softness, self.neighbours)[self.ranks], 0.0)

    def graph(self, positions: np.ndarray, surface: np.ndarray) -> SpringGraph:
        """The graph of anchors at [N, 3] metres, some of which, [N] bool, can be seen."""
        return SpringGraph(
            positions=positions,
            springs=self.pairs,
            kinds=np.full(len(self.pairs), SpringKind.STRUCTURAL, np.uint8),
            rest_lengths=self.rest_lengths.astype(np.float32),
            surface=surface,
        )


def neighbour_count(anchors: int) -> int:
    """How many neighbours each of this many anchors asks for, n."""
    return min(anchors - 1, max(FIXED + 1, round(NEIGHBOUR_SHARE * anchors)))


def anchor_springs(positions: np.ndarray, neighbours: int | None = None) -> AnchorSprings:
    """Springs between anchors at [N, 3] metres, each of which asks for its nearest ones (`neighbour_count`)."""
    count = len(positions)
    asked = neighbour_count(count) if neighbours is None else neighbours
    nearest = cKDTree(positions).query(positions, k=count)[1]
    # Anchors at one place may come before the anchor itself.
    others = nearest[nearest != np.arange(count)[:, None]].reshape(count, count - 1)[:, :asked]
    node, other = np.repeat(np.arange(count), asked), others.ravel()
    pairs, spring = np.unique(np.sort(np.stack([node, other], axis=1), axis=1), axis=0, return_inverse=True)
    ranks = np.full(pairs.shape, -1)
    ranks[spring.ravel(), (node > other).astype(int)] = np.tile(np.arange(asked), count)
    lengths = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    return AnchorSprings(
        pairs=pairs.astype(np.int32),
        rest_lengths=np.maximum(lengths, SHORTEST_LENGTH),
        ranks=ranks,
        neighbours=asked,
    )


def soft_vector(softness: float, neighbours: int) -> np.ndarray:
    """[n] s, from 1 of the nearest neighbours to 0 where there is no spring left."""
    return np.clip(2.0 - np.exp(np.logaddexp(0.0, softness) * _places(neighbours)), 0.0, 1.0)


def soft_vector_slope(softness: float, neighbours: int) -> np.ndarray:
    """[n] derivative of `soft_vector` by h; 0 where there is no spring left."""
    places = _places(neighbours)
    growth = np.exp(np.logaddexp(0.0, softness) * places)
    return np.where(growth < 2.0, -places * growth / (1.0 + np.exp(-softness)), 0.0)


def _places(neighbours: int) -> np.ndarray:
    """[n] x of each rank: 0 of the nearest F, and from there to below 1."""
    loose = max(neighbours - FIXED, 1)
    return np.maximum(np.arange(neighbours) - FIXED, 0) / loose
