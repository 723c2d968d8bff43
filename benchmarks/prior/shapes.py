"""Meshes of towels, mitts, round cloths, toys, cushions and bags, from those of the rehearsal world.

All return vertices [V, 3] in metres about the origin and elements [K, 3] or [K, 4], vertex indices.
"""

from collections.abc import Callable

import numpy as np

from egophys_core.rehearsal.meshes import box_mesh, ellipsoid_mesh, sheet_mesh

Mesh = tuple[np.ndarray, np.ndarray]

LOBE_WIDTH = 0.55
"""Radians from the middle of a lobe to where it has 0.6 of its height."""


def towel(size: np.ndarray, random: np.random.Generator) -> Mesh:
    """A rectangle of `size` [3] metres, of which the third is not looked at."""
    return sheet_mesh(size)


def mitt(size: np.ndarray, random: np.random.Generator) -> Mesh:
    """A sheet in the outline of a mitt: its cuff at low x, round at high x, with a thumb at high y."""
    palm_width, thumb = random.uniform(0.66, 0.76), random.uniform(-0.1, 0.05)

    def inside(places: np.ndarray) -> np.ndarray:
        x, y = places.T
        beyond = np.clip((x - 0.15) / 0.35, 0.0, 1.0)
        on_palm = np.abs(y + 0.5 * (1.0 - palm_width)) <= 0.5 * palm_width * np.sqrt(1.0 - beyond**2)
        along = np.clip((y - 0.1) / 0.32, 0.0, 1.0)
        on_thumb = np.hypot(x - thumb - 0.15 * along, y - 0.1 - 0.32 * along) <= 0.1
        return on_palm | on_thumb

    return _cut_out(sheet_mesh(size), size, inside)


def round_cloth(size: np.ndarray, random: np.random.Generator) -> Mesh:
    """An ellipse of a sheet."""
    return _cut_out(sheet_mesh(size), size, lambda places: np.linalg.norm(places, axis=1) <= 0.5)


def toy(size: np.ndarray, random: np.random.Generator) -> Mesh:
    """An ellipsoid on a flat seat with two to four lobes: a head, ears, arms."""
    vertices, elements = ellipsoid_mesh(size / 2)
    directions = vertices / np.maximum(np.linalg.norm(vertices, axis=1, keepdims=True), 1e-9)
    radius = np.ones(len(vertices))
    for _ in range(random.integers(2, 5)):
        around, rise = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.1, 1.2)
        middle = np.array([np.cos(around) * np.cos(rise), np.sin(around) * np.cos(rise), np.sin(rise)])
        radius += random.uniform(0.1, 0.35) * np.exp((directions @ middle - 1.0) / LOBE_WIDTH**2)
    return vertices * radius[:, None], elements


def two_lobed_toy(size: np.ndarray, random: np.random.Generator) -> Mesh:
    """A long ellipsoid that is slim in its middle, as a body and a head."""
    vertices, elements = ellipsoid_mesh(size / 2)
    middle = random.uniform(-0.06, 0.06) * size[0]
    slim = 1.0 - random.uniform(0.25, 0.4) * np.exp(-(((vertices[:, 0] - middle) / (0.2 * size[0])) ** 2))
    return vertices * np.column_stack([np.ones_like(slim), slim, slim]), elements


def cushion(size: np.ndarray, random: np.random.Generator) -> Mesh:
    """A box."""
    return box_mesh(size)


def bag(size: np.ndarray, random: np.random.Generator) -> Mesh:
    """A standing box that bulges in its middle and is gathered at its top."""
    vertices, elements = box_mesh(size)
    height = vertices[:, 2] / size[2] + 0.5
    width = 1.0 + random.uniform(0.05, 0.15) * np.sin(np.pi * height) - random.uniform(0.25, 0.45) * height**3
    return vertices * np.column_stack([width, width, np.ones_like(width)]), elements


def _cut_out(mesh: Mesh, size: np.ndarray, inside: Callable[[np.ndarray], np.ndarray]) -> Mesh:
    """The triangles whose middles are inside an outline, of places [M, 2] from -0.5 to 0.5 of the size."""
    vertices, elements = mesh
    kept = elements[inside(vertices[elements].mean(axis=1)[:, :2] / size[:2])]
    used, elements = np.unique(kept, return_inverse=True)
    return vertices[used], elements.reshape(-1, 3)
