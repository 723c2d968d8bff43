"""What controller points do to an object: springs to the nodes they hold (paper, App. B.2), how far they press."""

from dataclasses import dataclass

import numpy as np

from egophys_core.simulation.controls import ContactKind

FEWEST_NEIGHBOURS = 5
"""K_min: with fewer nodes within the radius a controller point of a flat object also takes its nearest ones."""

LEAST_CUTOFF = 0.15
"""Metres; the fallback reaches at most max(2.5 r_c, this)."""


@dataclass(frozen=True, kw_only=True)
class Attachments:
    """The contacts of one rollout: the springs of points that hold; of each that presses the node that it touches."""

    nodes: np.ndarray
    """[A] int32."""
    controllers: np.ndarray
    """[A] int32, index of the controller point."""
    rest_lengths: np.ndarray
    """[A] float32, metres: the distance when the contact began, so force comes from motion alone. A point that presses
    pushes whatever comes nearer than that."""
    kinds: np.ndarray
    """[A] uint8, `ContactKind`."""

    @property
    def holds(self) -> np.ndarray:
        """[A] bool: whether it is a spring, and not the nearest node of a point that presses."""
        return np.asarray(self.kinds == ContactKind.HOLD)

    def identities(self) -> list[tuple[int, int, int]]:
        """Node, controller and kind of each: a press that becomes a hold is another contact."""
        return list(zip(self.nodes.tolist(), self.controllers.tolist(), self.kinds.tolist(), strict=True))

    def of_controllers(self, keep: np.ndarray) -> "Attachments":
        """Only the contacts of controllers where `keep` [C] is True."""
        kept = keep[self.controllers]
        return Attachments(**{name: values[kept] for name, values in vars(self).items()})

    def joined(self, other: "Attachments") -> "Attachments":
        """The contacts of both."""
        return Attachments(
            **{name: np.concatenate([values, getattr(other, name)]) for name, values in vars(self).items()}
        )


NOTHING_HELD = Attachments(
    nodes=np.zeros(0, np.int32),
    controllers=np.zeros(0, np.int32),
    rest_lengths=np.zeros(0, np.float32),
    kinds=np.zeros(0, np.uint8),
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
    """What begins when some controller points begin to hold or press: these touch the node that is nearest.

    A point that holds takes its nearest `max_neighbours` nodes within `radius`. A point of a flat object that finds
    fewer than K_min there takes its K_min nearest within max(2.5 radius, 0.15 m). For a solid that fallback is used
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
    presses = begins[taking] == ContactKind.PRESS
    held = np.where(presses[:, None], rank == 0, held)
    row, node = np.nonzero(held)
    return Attachments(
        nodes=node.astype(np.int32),
        controllers=taking[row].astype(np.int32),
        rest_lengths=distances[row, node].astype(np.float32),
        kinds=begins[taking[row]].astype(np.uint8),
    )
