"""The soft objects: their meshes, their material, and the material points that are tracked on them."""

from dataclasses import dataclass

import numpy as np

from egophys_core.rehearsal.meshes import boundary, box_mesh, ellipsoid_mesh, sheet_mesh, spread_points, without_flat
from egophys_core.rehearsal.options import RehearsalObject, RehearsalOptions

SKIN = 0.005
"""Radius of a vertex in contact, metres: how high a sheet lies above the table."""


@dataclass(frozen=True, kw_only=True)
class SoftBody:
    """A mesh and its material. SI units, frame `world`, table at z = 0."""

    vertices: np.ndarray
    """[V, 3] metres, unstrained, standing on the table."""
    elements: np.ndarray
    """[K, 3] triangles of a sheet or [K, 4] tetrahedra of a solid, vertex indices."""
    surface: np.ndarray
    """[F, 3] triangles of the surface, vertex indices."""
    mass: float
    """kg."""
    young: float
    """Young's modulus, Pa."""
    stiffness_shares: np.ndarray
    """[K] the modulus of each element over `young`; ones for the same material everywhere."""
    poisson: float
    thickness: float
    """Metres; of a sheet only."""
    damping: float
    """Seconds: damping over stiffness of the material."""
    friction: float
    """Coulomb coefficient with the table."""
    tracked_triangles: np.ndarray
    """[N] the surface triangle each tracked point is on."""
    tracked_weights: np.ndarray
    """[N, 3] its barycentric coordinates."""

    @property
    def is_sheet(self) -> bool:
        """Whether the elements are triangles."""
        return self.elements.shape[1] == 3

    def tracked(self, positions: np.ndarray) -> np.ndarray:
        """Places of the tracked points [..., N, 3] for vertices at `positions` [..., V, 3]."""
        corners = positions[..., self.surface[self.tracked_triangles], :]
        return np.einsum("nk,...nkd->...nd", self.tracked_weights, corners)


def make_body(options: RehearsalOptions, object_seed: int) -> SoftBody:
    """The object that a seed stands for: the same one for all motions and effects."""
    random = np.random.default_rng([object_seed, list(RehearsalObject).index(options.object)])

    def around(value: float, share: float = 1.0) -> float:
        return float(value * np.exp(options.spread * share * random.uniform(-1.0, 1.0)))

    thickness, damping = 0.0, 0.0006
    if options.object is RehearsalObject.SHEET:
        size = np.array([around(0.28, 0.5), around(0.21, 0.5)])
        vertices, elements = sheet_mesh(size)
        # Bends as a towel does: over a length of some 35 mm. A thinner one crumples differently after every breath.
        surface, mass, young, poisson = elements, around(0.1), around(4e4, 1.5), 0.2
        thickness, damping = 0.006, 0.0015
    else:
        size = np.array([around(0.14, 0.5), around(0.11, 0.5), around(0.11, 0.5)])
        if options.object is RehearsalObject.ELLIPSOID:
            vertices, elements = ellipsoid_mesh(size / 2)
        else:
            vertices, elements = box_mesh(size)
        # The flat elements that are left out would leave gaps inside that look like surface.
        surface, elements = boundary(elements), without_flat(vertices, elements)
        mass, young, poisson = around(0.25), around(1e4, 2.0), 0.3
    vertices[:, 2] += SKIN - vertices[:, 2].min()
    triangles, weights = spread_points(vertices[surface], options.points, random)
    return SoftBody(
        vertices=vertices,
        elements=elements,
        surface=surface,
        mass=mass,
        young=young,
        stiffness_shares=np.ones(len(elements)),
        poisson=poisson,
        thickness=thickness,
        damping=damping,
        friction=around(0.5),
        tracked_triangles=triangles,
        tracked_weights=weights,
    )
