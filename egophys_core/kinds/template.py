"""Templates: what an object looks like that is seen at a few markers only, as a lattice of springs.

The lattice is cubic with springs to next and to diagonal neighbours of one stiffness k: an isotropic solid with Young's
modulus E = 2.5 k / h and Poisson's ratio 1/4 for cubic cells of edge h (central forces allow no other ratio; Born and
Huang, Dynamical Theory of Crystal Lattices, 1954, ch. 3). Every node stands for an equal cell and so has an equal mass.
"""

import re
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from egophys_core.constants import LARGEST_OBJECT_M, SMALLEST_OBJECT_M
from egophys_core.errors import OptionsError
from egophys_core.kinds.mesh_file import Mesh, read_mesh

ACROSS = 4
"""Cells across the thinnest side."""

MOST_NODES = 400
"""Cells beyond which they are made longer, and then fewer across."""

MOST_CELLS = 5000
"""Cells that can be simulated; those of a plate are as many as it is wide for its thickness, whatever their length."""

THINNEST_M = 0.0005
"""Metres: the thinnest edge that a template may have."""

LONGEST_CELL = 4.0
"""Times its width."""

NEIGHBOURS = tuple(
    offset
    for offset in product((-1, 0, 1), repeat=3)
    if 0 < sum(abs(step) for step in offset) < 3 and offset > (0, 0, 0)
)
"""Half of the 6 next and 12 diagonal neighbours of a cell."""


@dataclass(frozen=True, kw_only=True)
class Template:
    """A solid in a frame of its own: x along its longest side, y and z across, the origin at its box's centre."""

    size: np.ndarray
    """[3] metres: the edges of its box, the longest first."""
    mesh: Mesh | None = None
    """What fills the box; None for all of it. In the template's frame."""

    @property
    def length(self) -> float:
        """Metres along x."""
        return float(self.size[0])


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """Cells of a template, and the springs between them."""

    nodes: np.ndarray
    """[N, 3] metres, centres of the cells in the template's frame."""
    layers: np.ndarray
    """[N] int: the layer of each node along x."""
    springs: np.ndarray
    """[E, 2] int, i < j."""
    spacing: float
    """Edge of a cubic cell of the same volume, metres."""


def parse_template(text: str) -> Template:
    """The template that `box:LxWxH` (metres) or the path of a mesh file names.

    Raises:
        OptionsError: neither of them, or a size that is none of an object in metres.
    """
    template = _parse_box(text) if text.startswith("box:") else mesh_template(read_mesh(Path(text)))
    longest, thinnest = template.length, template.size.min()
    if not (SMALLEST_OBJECT_M <= longest <= LARGEST_OBJECT_M and thinnest >= THINNEST_M):
        raise OptionsError(
            f"template {text} measures {' x '.join(f'{edge:.3g}' for edge in template.size)} m; give it in "
            f"metres (millimetres divided by 1000), its longest edge {SMALLEST_OBJECT_M:g} .. {LARGEST_OBJECT_M:g} m "
            f"and its thinnest at least {THINNEST_M:g} m"
        )
    return template


def _parse_box(text: str) -> Template:
    match = re.fullmatch(r"box:([^x]+)x([^x]+)x([^x]+)", text)
    try:
        size = [float(edge) for edge in match.groups()] if match else []
    except ValueError:
        size = []
    if len(size) != 3 or not all(0.0 < edge < np.inf for edge in size):
        raise OptionsError(f"template must be box:LxWxH with three positive edges in metres, got {text!r}")
    return box_template(*size)


def box_template(*edges: float) -> Template:
    """A box; its longest edge becomes x, the others keep their order."""
    size = np.array(edges)
    long = int(size.argmax())
    return Template(size=np.array([size[long], *np.delete(size, long)]))


def mesh_template(mesh: Mesh) -> Template:
    """A mesh; the longest edge of its box becomes x, the other axes keep their order."""
    low, high = mesh.corners.min(axis=(0, 1)), mesh.corners.max(axis=(0, 1))
    long = int((high - low).argmax())
    order = [long, *np.delete(np.arange(3), long)]
    corners = (mesh.corners - (low + high) / 2)[..., order]
    return Template(size=(high - low)[order], mesh=Mesh(corners=corners))


def cut(template: Template, before: float, after: float) -> Template:
    """The template without so many metres at its -x and at its +x end; its origin is the centre of what is left."""
    left = template.length - before - after
    mesh = None
    if template.mesh is not None:
        mesh = Mesh(corners=template.mesh.corners - [(before - after) / 2, 0.0, 0.0])
    return replace(template, size=np.array([left, *template.size[1:]]), mesh=mesh)


def lattice(template: Template, *, held_ends: tuple[bool, bool]) -> Lattice:
    """Fill a template with equal cells.

    At a held end, -x or +x, the first cells are cut in half by the end face, so that their centres lie on it; at a free
    end the last cells end there. So the mass of the cells that move is that of the free length.

    Args:
        held_ends: whether its -x and its +x end are held.

    Raises:
        OptionsError: too thin for its width, or a mesh too thin for any cell's centre to lie inside.
    """
    across, along = _cell_counts(template.size, sum(held_ends))
    if along * across.prod() > MOST_CELLS:
        raise OptionsError(
            f"the template, {' x '.join(f'{each:.3g}' for each in template.size)} m, is so thin for its width that it "
            f"takes {along * across.prod()} cells, at most {MOST_CELLS} can be simulated; give a thicker one"
        )
    edge = template.length / (along - 0.5 * sum(held_ends))
    x = -template.length / 2 + edge * (np.arange(along) + (0.0 if held_ends[0] else 0.5))
    axes = [x, *(_centres(width, count) for width, count in zip(template.size[1:], across, strict=True))]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    # A centre on the end face of a mesh counts as inside.
    taken = (
        np.ones(grid.shape[:3], bool)
        if template.mesh is None
        else template.mesh.inside((grid * [1.0 - 1e-4, 1.0, 1.0]).reshape(-1, 3)).reshape(grid.shape[:3])
    )
    if not taken.any():
        raise OptionsError(f"the template mesh, {template.size} m, holds no cell; is it closed and in metres?")
    number = np.where(taken, np.cumsum(taken).reshape(taken.shape) - 1, -1)
    return Lattice(
        nodes=grid[taken],
        layers=np.broadcast_to(np.arange(along)[:, None, None], taken.shape)[taken],
        springs=np.concatenate([_links(number, offset) for offset in NEIGHBOURS]),
        spacing=float(np.cbrt(edge * np.prod(template.size[1:] / across))),
    )


def stiffness_of_modulus(modulus: float | np.ndarray, spacing: float) -> np.ndarray:
    """N/m of each spring, for Young's modulus in Pa and cells of edge `spacing`, metres."""
    return np.asarray(modulus * spacing / 2.5)


def _cell_counts(size: np.ndarray, held: int) -> tuple[np.ndarray, int]:
    """How many cells across, [2], and along."""
    for across in range(ACROSS, 1, -1):
        width = size.min() / across
        counts = np.maximum(np.round(size[1:] / width), 2).astype(int)
        for stretch in (1.0, 2.0, LONGEST_CELL):
            along = max(3, round(size[0] / (stretch * width) + 0.5 * held))
            if along * counts.prod() <= MOST_NODES:
                return counts, along
    return counts, max(3, int(MOST_NODES // counts.prod()))


def _centres(width: float, count: int) -> np.ndarray:
    return width * ((np.arange(count) + 0.5) / count - 0.5)


def _links(number: np.ndarray, offset: tuple[int, ...]) -> np.ndarray:
    """[E, 2] cells `offset` apart, numbered by `number` [X, Y, Z], -1 where there is none."""
    here, there = (
        number[tuple(slice(max(0, sign * step), sign * step if sign * step < 0 else None) for step in offset)]
        for sign in (-1, 1)
    )
    both = (here >= 0) & (there >= 0)
    return np.sort(np.stack([here[both], there[both]], axis=1), axis=1)
