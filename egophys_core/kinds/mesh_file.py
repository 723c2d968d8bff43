"""Triangle meshes from files, and what lies inside them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from egophys_core.errors import OptionsError

SUFFIXES = (".obj", ".stl", ".ply")


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """A closed surface of triangles."""

    corners: np.ndarray
    """[F, 3, 3] metres: the three corners of each triangle, in the file's frame."""

    def __post_init__(self) -> None:
        if self.corners.ndim != 3 or self.corners.shape[1:] != (3, 3) or len(self.corners) < 4:
            raise OptionsError(f"a mesh needs at least 4 triangles, [F, 3, 3] in metres, got {self.corners.shape}")
        if not np.isfinite(self.corners).all():
            raise OptionsError("a mesh has corners that are not finite numbers")

    def inside(self, points: np.ndarray) -> np.ndarray:
        """[P] bool: points [P, 3] from which a ray crosses the surface an odd number of times."""
        # A direction without symmetry: along an axis rays would meet edges of meshes that follow the axes.
        direction = np.array([0.9123, 0.3121, 0.2649])
        a, b, c = self.corners.transpose(1, 0, 2)
        edge1, edge2 = b - a, c - a
        across = np.cross(direction, edge2)
        determinant = np.einsum("ij,ij->i", edge1, across)
        faces = np.abs(determinant) > 1e-30
        scale = 1.0 / determinant[faces]
        found = np.zeros(len(points), bool)
        # Moeller and Trumbore, J. Graphics Tools 2(1) (1997) 21.
        for index, point in enumerate(points):
            offset = point - a[faces]
            u = np.einsum("ij,ij->i", offset, across[faces]) * scale
            turned = np.cross(offset, edge1[faces])
            v = turned @ direction * scale
            distance = np.einsum("ij,ij->i", edge2[faces], turned) * scale
            hits = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
            found[index] = hits.sum() % 2 == 1
        return found


def read_mesh(path: Path) -> Mesh:
    """Read the triangles of a mesh file, in metres; polygons are cut into fans.

    Raises:
        OptionsError: of another kind, absent, cut, or without triangles.
    """
    # Takes a second to import, and only who builds from a mesh needs it.
    import trimesh

    if path.suffix.lower() not in SUFFIXES:
        raise OptionsError(
            f"template {path} is neither box:LxWxH (metres) nor a mesh; meshes are read from "
            f"{', '.join(SUFFIXES)} files, in metres"
        )
    if not path.is_file():
        raise OptionsError(f"cannot read template {path}: there is no such file")
    try:
        return Mesh(corners=np.asarray(trimesh.load_mesh(path, process=False).triangles, float))
    except Exception as error:
        # The library's readers raise whatever a broken file does to their arithmetic.
        raise OptionsError(f"template {path} is not a whole {path.suffix} file of 4 triangles or more") from error
