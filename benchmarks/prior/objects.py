"""The soft objects of the set: their shapes, and how much their size and material differ."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from benchmarks.prior import shapes
from benchmarks.prior.variations import Parts, Variation, shares_of
from egophys_core.rehearsal.bodies import SKIN, SoftBody
from egophys_core.rehearsal.meshes import boundary, spread_points, without_flat


class Shape(StrEnum):
    """What kind of object it is."""

    TOWEL = "towel"
    MITT = "mitt"
    ROUND_CLOTH = "round_cloth"
    TOY = "toy"
    TWO_LOBED_TOY = "two_lobed_toy"
    CUSHION = "cushion"
    BAG = "bag"


Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Family:
    """Between what the objects of a shape differ; each is drawn evenly, stiffness in its logarithm."""

    mesh: Callable[[np.ndarray, np.random.Generator], shapes.Mesh]
    size: tuple[Range, Range, Range]
    """Metres along x, y, z; z of a sheet is its thickness."""
    density: Range
    """kg/m^3."""
    young: Range
    """Pa, the mean over the object."""
    is_sheet: bool = False


FAMILIES: dict[Shape, Family] = {
    Shape.TOWEL: Family(
        mesh=shapes.towel,
        size=((0.23, 0.32), (0.18, 0.24), (0.005, 0.008)),
        density=(180.0, 320.0),
        young=(1e4, 8e4),
        is_sheet=True,
    ),
    Shape.MITT: Family(
        mesh=shapes.mitt,
        size=((0.26, 0.32), (0.19, 0.23), (0.006, 0.009)),
        density=(150.0, 280.0),
        young=(8e3, 6e4),
        is_sheet=True,
    ),
    Shape.ROUND_CLOTH: Family(
        mesh=shapes.round_cloth,
        size=((0.23, 0.3), (0.22, 0.27), (0.005, 0.008)),
        density=(180.0, 320.0),
        young=(1e4, 8e4),
        is_sheet=True,
    ),
    Shape.TOY: Family(
        mesh=shapes.toy,
        size=((0.11, 0.15), (0.1, 0.13), (0.1, 0.14)),
        density=(150.0, 350.0),
        young=(3e3, 1.5e4),
    ),
    Shape.TWO_LOBED_TOY: Family(
        mesh=shapes.two_lobed_toy,
        size=((0.17, 0.21), (0.1, 0.13), (0.1, 0.13)),
        density=(150.0, 350.0),
        young=(3e3, 1.5e4),
    ),
    Shape.CUSHION: Family(
        mesh=shapes.cushion,
        size=((0.13, 0.19), (0.11, 0.14), (0.08, 0.12)),
        density=(100.0, 250.0),
        young=(2.5e3, 1e4),
    ),
    Shape.BAG: Family(
        mesh=shapes.bag,
        size=((0.11, 0.15), (0.09, 0.11), (0.13, 0.17)),
        density=(100.0, 250.0),
        young=(2.5e3, 1e4),
    ),
}

FRICTION: Range = (0.35, 0.65)

USUAL_DAMPING = {True: 0.0015, False: 0.0006}
"""Seconds, of sheets and of solids: those of `egophys rehearse`."""

LARGEST_SPECIFIC_STIFFNESS = {True: 1000.0, False: 100.0}
"""Pa m^3/kg of the stiffest place, for sheets and for solids: the steps of the rehearsal world follow three times as
much."""

LARGEST_VISCOSITY = {True: 0.2, False: 0.02}
"""m^2/s, the same of stiffness times damping over density."""


def make_object(shape: Shape, variation: Variation, seed: int, *, points: int) -> SoftBody:
    """The object that a seed stands for, with so many tracked points.

    Where its stiffest place would be too stiff for the steps of the rehearsal world all of it is softer, and where that
    would be damped too much all of it is damped less.
    """
    random = np.random.default_rng([seed, list(Shape).index(shape), list(Variation).index(variation)])
    family = FAMILIES[shape]
    size = np.array([random.uniform(*each) for each in family.size])
    density, friction = random.uniform(*family.density), random.uniform(*FRICTION)
    young = float(np.exp(random.uniform(*np.log(family.young))))
    vertices, elements = family.mesh(size, random)
    # The flat elements that are left out would leave gaps inside that look like surface.
    surface = elements if family.is_sheet else boundary(elements)
    elements = elements if family.is_sheet else without_flat(vertices, elements)
    vertices[:, 2] += SKIN - vertices[:, 2].min()
    parts = Parts(vertices=vertices, elements=elements)
    shares = shares_of(variation, parts, random)
    thickness = float(size[2]) if family.is_sheet else 0.0
    young = min(young, LARGEST_SPECIFIC_STIFFNESS[family.is_sheet] * density / shares.max())
    most_damping = LARGEST_VISCOSITY[family.is_sheet] * density / (young * shares.max())
    triangles, weights = spread_points(vertices[surface], points, random)
    return SoftBody(
        vertices=vertices,
        elements=elements,
        surface=surface,
        mass=float(density * parts.volumes.sum() * (thickness if family.is_sheet else 1.0)),
        young=young,
        stiffness_shares=shares,
        poisson=0.2 if family.is_sheet else 0.3,
        thickness=thickness,
        damping=min(USUAL_DAMPING[family.is_sheet], most_damping),
        friction=friction,
        tracked_triangles=triangles,
        tracked_weights=weights,
    )


def made_uniform(body: SoftBody) -> SoftBody:
    """The same object with its mean stiffness everywhere."""
    return replace(body, stiffness_shares=np.ones(len(body.elements)))
