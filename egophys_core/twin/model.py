"""ObjectModel: what is needed to simulate an object."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from egophys_core.effects.effect import TwinEffect
from egophys_core.errors import TwinError
from egophys_core.twin.graph import SpringGraph, SpringKind
from egophys_core.twin.parameters import PhysicalParameters

FOOT_M = 0.0025
"""Metres above a solid's lowest node up to which nodes are part of its foot."""


class ObjectKind(StrEnum):
    """How an object resists deformation; decides the graph and the fitted parameters."""

    SHEET = "sheet"
    """Towel, cloth, bag: bending springs, strain limit, ground projection."""
    SOLID = "solid"
    """Plush toy: filled inside, no bending springs, drag instead of strain limit."""
    ROD = "rod"
    """Cable, rope: the nodes of its centre line one after the other, a spring from each to the next; it resists bending
    as a line does, not by springs."""


@dataclass(frozen=True, kw_only=True)
class ObjectModel:
    """A spring graph with a stiffness per spring and global parameters."""

    kind: ObjectKind
    graph: SpringGraph
    parameters: PhysicalParameters
    stiffness: np.ndarray
    """[E] float32, N/m, per spring."""
    effects: tuple[TwinEffect, ...] = ()
    """What acts besides springs, gravity, table and hands (`discrepancy.effects`)."""

    def __post_init__(self) -> None:
        if self.stiffness.shape != (len(self.graph.springs),):
            raise TwinError(
                f"stiffness must be ({len(self.graph.springs)},), one per spring, got {self.stiffness.shape}"
            )
        if self.kind == ObjectKind.ROD and not np.array_equal(self.graph.springs, chain(len(self.graph.positions))):
            raise TwinError("the springs of a rod must link each node to the next, in order")
        if not (np.isfinite(self.stiffness).all() and (self.stiffness > 0).all()):
            raise TwinError(f"stiffness must be finite and positive, got a minimum of {self.stiffness.min()} N/m")

    @property
    def spring_damping(self) -> np.ndarray:
        """[E] float32, N s/m, per spring."""
        return per_kind(self.graph, self.parameters.damping, self.parameters.bending_damping_ratio)

    @property
    def node_masses(self) -> np.ndarray:
        """[N] float32, kg: the total mass in equal parts; a rod's as its length is."""
        nodes = len(self.graph.positions)
        if self.kind == ObjectKind.ROD:
            halves = np.pad(self.graph.rest_lengths / 2.0, 1)
            shares = (halves[:-1] + halves[1:]) / halves.sum() / 2.0
            return (self.parameters.total_mass * shares).astype(np.float32)
        return np.full(nodes, self.parameters.total_mass / nodes, np.float32)


def chain(nodes: int) -> np.ndarray:
    """[N - 1, 2] int32: each of N nodes and the next."""
    return np.stack([np.arange(nodes - 1), np.arange(1, nodes)], axis=1).astype(np.int32)


def resting_height(kind: ObjectKind, positions: np.ndarray) -> float:
    """z at which an object that lies on the table, nodes [N, 3], touches it: the median of a sheet's nodes, the
    mean of a solid's foot; the lowest node of all would only be the one with the most noise."""
    heights = positions[:, 2].astype(np.float64)
    if kind == ObjectKind.SHEET:
        return float(np.median(heights))
    return float(heights[heights <= heights.min() + FOOT_M].mean())


def per_kind(graph: SpringGraph, structural: float, bending_ratio: float) -> np.ndarray:
    """[E] float32: one number for structural springs, that number times a ratio for bending springs."""
    ratio = np.where(graph.kinds == SpringKind.BENDING, bending_ratio, 1.0)
    return (ratio * structural).astype(np.float32)
