"""Triangle meshes from OBJ and STL files, and what lies inside them."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from egophys_core.errors import OptionsError

SUFFIXES = (".obj", ".stl")

STL_HEADER_BYTES = 84
"""Of a binary STL: 80 of text and the number of triangles."""

STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


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
    """Read the triangles of an OBJ or STL file, in metres.

    Raises:
        OptionsError: of another kind, absent, cut, or without triangles.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise OptionsError(
            f"template {path} is neither box:LxWxH (metres) nor a mesh; meshes are read from {' and '.join(SUFFIXES)} "
            "files, in metres"
        )
    try:
        content = path.read_bytes()
    except OSError as error:
        raise OptionsError(f"cannot read template {path}: {error.strerror}") from error
    try:
        return Mesh(corners=_obj(content) if suffix == ".obj" else _stl(content))
    except (ValueError, IndexError) as error:
        raise OptionsError(f"template {path} is not a whole {suffix} file: {error}") from error


def _obj(content: bytes) -> np.ndarray:
    """Corners of the faces of an OBJ file; polygons are cut into fans, all but `v` and `f` lines are skipped."""
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line in content.decode("utf-8", errors="replace").splitlines():
        word, *values = line.split() or [""]
        if word == "v":
            vertices.append([float(value) for value in values[:3]])
        elif word == "f":
            numbers = [int(value.split("/")[0]) for value in values]
            # Numbers begin at 1; negative ones count back from the last vertex so far.
            corners = [number - 1 if number > 0 else len(vertices) + number for number in numbers]
            faces.extend((corners[0], second, third) for second, third in pairwise(corners[1:]))
    return np.array(vertices, float)[np.array(faces, int).reshape(-1, 3)]


def _stl(content: bytes) -> np.ndarray:
    """Corners of the triangles of an STL file, binary or text."""
    count = int.from_bytes(content[80:STL_HEADER_BYTES], "little")
    if len(content) == STL_HEADER_BYTES + count * STL_TRIANGLE.itemsize:
        return np.frombuffer(content, STL_TRIANGLE, count, STL_HEADER_BYTES)["corners"].astype(float)
    if not content.lstrip().startswith(b"solid"):
        raise ValueError(f"{len(content)} bytes where a binary STL of {count} triangles has another length")
    rows = [line.split()[1:4] for line in content.decode("utf-8", errors="replace").splitlines() if "vertex" in line]
    return np.array(rows, float).reshape(-1, 3, 3)
