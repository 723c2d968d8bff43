"""Springs between controller points and the nodes they hold or press (paper, App. B.2)."""

from dataclasses import dataclass

import numpy as np

from egophys_core.simulation.controls import ContactKind
from egophys_core.simulation.terms.springs import UNLIMITED

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
    """[A] float32, metres: the distance when the contact began, so force comes from motion alone."""
    longest_extensions: np.ndarray
    """[A] float32, metres: `UNLIMITED` for a hold, 0 for a press, which does not pull."""

    def identities(self) -> list[tuple[int, int, float]]:
        """Node, controller and longest extension of each spring: a press that becomes a hold is another contact."""
        return list(zip(self.nodes.tolist(), self.controllers.tolist(), self.longest_extensions.tolist(), strict=True))

    def of_controllers(self, keep: np.ndarray) -> "Attachments":
        """Only the springs of controllers where `keep` [C] is True."""
        kept = keep[self.controllers]
        return Attachments(**{name: values[kept] for name, values in vars(self).items()})

    def joined(self, other: "Attachments") -> "Attachments":
        """The springs of both."""
        return Attachments(
            **{name: np.concatenate([values, getattr(other, name)]) for name, values in vars(self).items()}
        )


NOTHING_HELD = Attachments(
    nodes=np.zeros(0, np.int32),
    controllers=np.zeros(0, np.int32),
    rest_lengths=np.zeros(0, np.float32),
    longest_extensions=np.zeros(0, np.float32),
)


def attach(
    nodes: np.ndarray,
    controllers: np.ndarray,
    begins: np.ndarray,
    *,
    radius: float,
    max_neighbours: int,
    flat: bool,
) -> Attachments:
    """Controller springs made when some controller points begin to hold or press.

    Each point takes its nearest `max_neighbours` nodes within `radius`. A point of a flat object that finds fewer
    than K_min there takes its K_min nearest within max(2.5 radius, 0.15 m). For a solid that fallback is used
    only if no point found any node, to avoid springs across the object.

    Args:
        nodes: [N, 3] metres.
        controllers: [C, 3] metres.
        begins: [C] `ContactKind` of the contacts that begin, NONE for other points.
        radius: r_c, metres.
    """
    taking = np.flatnonzero(begins)
    if len(taking) == 0:
        return NOTHING_HELD
    distances = np.linalg.norm(controllers[taking, None] - nodes[None], axis=2)
    rank = np.argsort(np.argsort(distances, axis=1, kind="stable"), axis=1)
    held = (distances <= radius) & (rank < max_neighbours)
    lacking = held.sum(axis=1) < FEWEST_NEIGHBOURS
    if flat or not held.any():
        near = distances <= max(2.5 * radius, LEAST_CUTOFF)
        held |= lacking[:, None] & near & (rank < min(FEWEST_NEIGHBOURS, max_neighbours))
    row, node = np.nonzero(held)
    return Attachments(
        nodes=node.astype(np.int32),
        controllers=taking[row].astype(np.int32),
        rest_lengths=distances[row, node].astype(np.float32),
        longest_extensions=np.where(begins[taking[row]] == ContactKind.HOLD, UNLIMITED, 0.0).astype(np.float32),
    )
