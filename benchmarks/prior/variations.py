"""How the stiffness of an object varies from place to place: a hem, a lining, a core, stuffing, a skin.

Every field takes the mesh and a random generator and returns [K] factors, 0.25 to 6, one an element.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from egophys_core.rehearsal.meshes import boundary


class Variation(StrEnum):
    """What differs within an object."""

    UNIFORM = "uniform"
    HEM = "hem"
    LINING = "lining"
    PATCH = "patch"
    SEAM = "seam"
    CORE = "core"
    STUFFING = "stuffing"
    SKIN = "skin"


@dataclass(frozen=True, kw_only=True)
class Parts:
    """A mesh as the fields see it."""

    vertices: np.ndarray
    """[V, 3] metres."""
    elements: np.ndarray
    """[K, 3] or [K, 4] vertex indices."""

    @property
    def middles(self) -> np.ndarray:
        """[K, 3] metres, the middle of each element."""
        return self.vertices[self.elements].mean(axis=1)

    @property
    def relative(self) -> np.ndarray:
        """[K, 3] those middles from -1 to 1 of the extent along each axis; 0 along one without extent."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        return (self.middles - (low + high) / 2.0) / np.maximum((high - low) / 2.0, 1e-9)

    @property
    def volumes(self) -> np.ndarray:
        """[K] areas of triangles, m^2, or volumes of tetrahedra, m^3."""
        sides = self.vertices[self.elements[:, 1:]] - self.vertices[self.elements[:, :1]]
        if sides.shape[1] == 2:
            return 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        return np.abs(np.linalg.det(sides)) / 6.0


def shares_of(variation: Variation, parts: Parts, random: np.random.Generator) -> np.ndarray:
    """[K] stiffness of each element over the mean, in which each element counts by its volume."""
    factors = FIELDS[variation](parts, random)
    return factors / np.average(factors, weights=parts.volumes)


def _uniform(parts: Parts, random: np.random.Generator) -> np.ndarray:
    return np.ones(len(parts.elements))


def _hem(parts: Parts, random: np.random.Generator) -> np.ndarray:
    """A stiffer rim of a sheet, 1.2 to 2 cm wide."""
    sides = np.sort(np.concatenate([parts.elements[:, list(pair)] for pair in ((0, 1), (1, 2), (0, 2))]), axis=1)
    edges, counts = np.unique(sides, axis=0, return_counts=True)
    ends = parts.vertices[edges[counts == 1]]
    shares = np.linspace(0.0, 1.0, 5)[:, None, None]
    rim = ((1.0 - shares) * ends[:, 0] + shares * ends[:, 1]).reshape(-1, 3)
    distance = np.linalg.norm(parts.middles[:, None] - rim, axis=2).min(axis=1)
    return np.where(distance <= random.uniform(0.012, 0.02), random.uniform(3.5, 6.0), 1.0)


def _lining(parts: Parts, random: np.random.Generator) -> np.ndarray:
    """One side of a line through near the middle is stiffer."""
    angle, offset = random.uniform(0.0, 2.0 * np.pi), random.uniform(-0.15, 0.15)
    side = parts.relative[:, :2] @ [np.cos(angle), np.sin(angle)]
    return np.where(side > offset, random.uniform(4.0, 6.0), 1.0)


def _patch(parts: Parts, random: np.random.Generator) -> np.ndarray:
    """A round place is stiffer, or softer."""
    middle = random.uniform(-0.4, 0.4, 2)
    near = np.linalg.norm(parts.relative[:, :2] - middle, axis=1) <= random.uniform(0.45, 0.6)
    return np.where(near, random.choice([random.uniform(4.0, 6.0), random.uniform(0.25, 0.3)]), 1.0)


def _seam(parts: Parts, random: np.random.Generator) -> np.ndarray:
    """A band of some 3 cm through near the middle is stiffer."""
    angle = random.uniform(0.0, np.pi)
    across = np.array([-np.sin(angle), np.cos(angle)])
    middle = (parts.vertices.min(axis=0) + parts.vertices.max(axis=0))[:2] / 2.0 + random.uniform(-0.02, 0.02, 2)
    beside = np.abs((parts.middles[:, :2] - middle) @ across)
    return np.where(beside <= random.uniform(0.014, 0.02), random.uniform(4.5, 6.0), 1.0)


def _core(parts: Parts, random: np.random.Generator) -> np.ndarray:
    """The inside is stiffer, towards one end of the object."""
    middle = random.uniform(-0.3, 0.3, 3) * [1.0, 1.0, 0.5]
    inside = np.linalg.norm(parts.relative - middle, axis=1) <= random.uniform(0.5, 0.7)
    return np.where(inside, random.uniform(4.0, 6.0), 1.0)


def _stuffing(parts: Parts, random: np.random.Generator) -> np.ndarray:
    """Varies smoothly from place to place, by a factor of up to 2.5 to 3.5 either way."""
    waves = np.zeros(len(parts.elements))
    for _ in range(3):
        direction = random.normal(size=3)
        direction *= random.uniform(1.2, 2.2) / np.linalg.norm(direction)
        waves += np.sin(parts.relative @ direction + random.uniform(0.0, 2.0 * np.pi))
    waves -= (waves.min() + waves.max()) / 2.0
    return np.exp(waves / np.abs(waves).max() * np.log(random.uniform(2.5, 3.5)))


def _skin(parts: Parts, random: np.random.Generator) -> np.ndarray:
    """The elements at the surface of a solid are stiffer than its filling."""
    faces = np.sort(parts.elements[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]], axis=2)
    numbers = np.array([len(parts.vertices) ** 2, len(parts.vertices), 1])
    outer = np.isin(faces @ numbers, np.sort(boundary(parts.elements), axis=1) @ numbers).any(axis=1)
    return np.where(outer, random.uniform(4.0, 6.0), 1.0)


FIELDS: dict[Variation, Callable[[Parts, np.random.Generator], np.ndarray]] = {
    Variation.UNIFORM: _uniform,
    Variation.HEM: _hem,
    Variation.LINING: _lining,
    Variation.PATCH: _patch,
    Variation.SEAM: _seam,
    Variation.CORE: _core,
    Variation.STUFFING: _stuffing,
    Variation.SKIN: _skin,
}
