"""Springs between controller points and the nodes they take hold of (paper, App. B.2)."""

from dataclasses import dataclass

import numpy as np

FEWEST_NEIGHBOURS = 5
"""K_min: with fewer nodes within the radius a controller point of a flat object also takes its nearest ones."""

LEAST_CUTOFF = 0.15
"""Metres; the fallback reaches at most max(2.5 r_c, this)."""


@dataclass(frozen=True, kw_only=True)
class Attachments:
    """Controller springs of one rollout."""

    nodes: np.ndarray
    """[A] int32."""
    controllers: np.ndarray
    """[A] int32, index of the controller point."""
    rest_lengths: np.ndarray
    """[A] float32, metres: the distance when the hold began, so force comes from motion alone."""

    def of_controllers(self, keep: np.ndarray) -> "Attachments":
        """Only the springs of controllers where `keep` [C] is True."""
        kept = keep[self.controllers]
        return Attachments(
            nodes=self.nodes[kept], controllers=self.controllers[kept], rest_lengths=self.rest_lengths[kept]
        )

    def joined(self, other: "Attachments") -> "Attachments":
        """The springs of both."""
        return Attachments(
            nodes=np.concatenate([self.nodes, other.nodes]),
            controllers=np.concatenate([self.controllers, other.controllers]),
            rest_lengths=np.concatenate([self.rest_lengths, other.rest_lengths]),
        )


NOTHING_HELD = Attachments(
    nodes=np.zeros(0, np.int32), controllers=np.zeros(0, np.int32), rest_lengths=np.zeros(0, np.float32)
)


def attach(
    nodes: np.ndarray,
    controllers: np.ndarray,
    takes_hold: np.ndarray,
    *,
    radius: float,
    max_neighbours: int,
    flat: bool,
) -> Attachments:
    """Controller springs made when some controller points take hold.

    Each point holds its nearest `max_neighbours` nodes within `radius`. A point of a flat object that finds fewer
    than K_min there takes its K_min nearest within max(2.5 radius, 0.15 m). For a solid that fallback is used
    only if no point found any node, to avoid springs across the object.

    Args:
        nodes: [N, 3] metres.
        controllers: [C, 3] metres.
        takes_hold: [C] bool.
        radius: r_c, metres.
    """
    taking = np.flatnonzero(takes_hold)
    if len(taking) == 0:
        return NOTHING_HELD
    distances = np.linalg.norm(controllers[taking, None] - nodes[None], axis=2)
    rank = np.argsort(np.argsort(distances, axis=1, kind="stable"), axis=1)
    held = (distances <= radius) & (rank < max_neighbours)
    lacking = held.sum(axis=1) < FEWEST_NEIGHBOURS
    if flat or not held.any():
        reach = distances <= max(2.5 * radius, LEAST_CUTOFF)
        held |= lacking[:, None] & reach & (rank < min(FEWEST_NEIGHBOURS, max_neighbours))
    row, node = np.nonzero(held)
    return Attachments(
        nodes=node.astype(np.int32),
        controllers=taking[row].astype(np.int32),
        rest_lengths=distances[row, node].astype(np.float32),
    )
