"""ObjectModel: what is needed to simulate an object."""

from dataclasses import dataclass

import numpy as np

from egophys_core.effects.effect import TwinEffect
from egophys_core.errors import TwinError
from egophys_core.twin.codebook import Codebook
from egophys_core.twin.graph import SpringGraph, SpringKind
from egophys_core.twin.parameters import PhysicalParameters


@dataclass(frozen=True, kw_only=True)
class ObjectModel:
    """A spring graph with a stiffness per spring and global parameters."""

    kind: str
    """Name of the kind of object, of which all else that differs by kind is asked (`egophys_core.kinds`)."""
    graph: SpringGraph
    parameters: PhysicalParameters
    stiffness: np.ndarray
    """[E] float32, N/m, per spring; with a codebook what its offsets are added to, in logarithms."""
    codebook: Codebook | None = None
    """How the stiffness of each spring follows its place in the graph and how it is deformed; None if it is fixed."""
    intrinsic_curvature: np.ndarray | None = None
    """[N, 2] float32, 1/m: of a rod, its curvature at each node when nothing acts on it, to its level left and up,
    beyond that of the parameters; None where it is alike all along."""
    effects: tuple[TwinEffect, ...] = ()
    """What acts besides springs, gravity, table and hands (`egophys_core.effects`)."""

    def __post_init__(self) -> None:
        if self.stiffness.shape != (len(self.graph.springs),):
            raise TwinError(
                f"stiffness must be ({len(self.graph.springs)},), one per spring, got {self.stiffness.shape}"
            )
        if self.stiffness.dtype.kind != "f":
            raise TwinError(f"stiffness must be floating-point numbers in N/m, got {self.stiffness.dtype}")
        if not (np.isfinite(self.stiffness).all() and (self.stiffness > 0).all()):
            raise TwinError(f"stiffness must be finite and positive, got a minimum of {self.stiffness.min()} N/m")
        uneven, nodes = self.intrinsic_curvature, len(self.graph.positions)
        if uneven is not None and not (uneven.shape == (nodes, 2) and np.isfinite(uneven).all()):
            raise TwinError(f"intrinsic_curvature must be ({nodes}, 2) finite numbers in 1/m, got {uneven.shape}")

    @property
    def stiffness_model(self) -> str:
        """How stiff its springs are: `uniform` for each kind of spring, `dense` for each spring, or by a `codebook`."""
        if self.codebook is not None:
            return "codebook"
        kinds = [self.stiffness[self.graph.kinds == kind] for kind in SpringKind]
        return "uniform" if all(len(each) == 0 or each.min() == each.max() for each in kinds) else "dense"

    @property
    def spring_damping(self) -> np.ndarray:
        """[E] float32, N s/m, per spring."""
        return per_kind(self.graph, self.parameters.damping, self.parameters.bending_damping_ratio)


def chain(nodes: int) -> np.ndarray:
    """[N - 1, 2] int32: each of N nodes and the next."""
    return np.stack([np.arange(nodes - 1), np.arange(1, nodes)], axis=1).astype(np.int32)


def per_kind(graph: SpringGraph, structural: float, bending_ratio: float) -> np.ndarray:
    """[E] float32: one number for structural springs, that number times a ratio for bending springs."""
    ratio = np.where(graph.kinds == SpringKind.BENDING, bending_ratio, 1.0)
    return (ratio * structural).astype(np.float32)
