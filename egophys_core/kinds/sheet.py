"""Sheets: towels, cloth, bags. They have bending springs, a limit of strain, and lie flat on a table."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from egophys_core.kinds.kind import FittedParameter, FromSurface, Kind, RestShape, Searched
from egophys_core.kinds.spring_body import (
    VariantSizes,
    fitted,
    fitted_of_springs,
    searched_of_springs,
    spring_model,
    spring_variants,
    stiffness_of_springs,
)
from egophys_core.kinds.surface_faces import faces_of_sheet, nodes_across
from egophys_core.twin import ObjectModel, PhysicalParameters, SpringKind

NAME = "sheet"

FLATNESS = 0.12
"""Smallest over second largest spread; a sheet lies below this, a toy above."""

HALF_THICKNESS = 0.001
"""Metres from the middle of a sheet to its skin, of one that hangs: one that lies shows it by its height."""

MOST_DAMPING = 5.0
"""Dashpot over node mass, 1/s: bending springs have 20 times that."""

SEARCHED = (
    Searched(name="stiffness_rate", low=1e3, high=1e5, start=3e4, logarithmic=True),
    Searched(name="object_radius", low=1.0, high=3.0, start=1.5),
    Searched(name="object_neighbours", low=4.0, high=20.0, start=10.0),
    *searched_of_springs(most_damping=MOST_DAMPING),
    Searched(name="bending_ratio", low=1e-3, high=1.0, start=0.05, logarithmic=True),
    Searched(name="strain_limit", low=0.02, high=1.0, start=0.5, logarithmic=True),
    Searched(name="ground_projection", low=0.0, high=1.0, start=0.1),
    Searched(name="contact_threshold", low=0.0, high=0.01, start=0.002),
    Searched(name="collision_distance", low=0.5, high=1.0, start=0.75),
    Searched(name="collision_restitution", low=0.0, high=0.8, start=0.1),
    Searched(name="collision_friction", low=0.0, high=1.5, start=0.3),
)

OF_TABLE = {"restitution": 0.0, "friction": 0.5, "ground_projection": 0.0, "contact_threshold": 0.0}
"""What acts on a table alone, and what it is where there is none."""

SEARCHED_HANGING = (
    *(each for each in SEARCHED if each.name not in OF_TABLE),
    Searched(name="drag", low=0.01, high=5.0, start=0.3, logarithmic=True),
    Searched(name="bending_damping_ratio", low=0.02, high=50.0, start=5.0, logarithmic=True),
)
"""What hangs swings in the air."""

AS_SEARCHED = (
    "bending_ratio",
    "strain_limit",
    "ground_projection",
    "contact_threshold",
    "collision_restitution",
    "collision_friction",
    "drag",
    "bending_damping_ratio",
)
"""Parameters that are as they are searched, if they are."""

SIZES = VariantSizes(
    object_radii=(1.5, 2.0, 2.5),
    stiffness_rate=5e4,
    damping_rate=0.3,
    # Limp cloth, and felt.
    bending_ratios=(0.03, 0.3),
    # Cloth wrinkles between its nodes.
    compression_ratio=0.3,
    collides=True,
    bends=True,
)


def looks_flat(points: np.ndarray) -> bool:
    """Whether points at rest [P, 3] lie near a plane."""
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T)), 0.0))
    return bool(spread[0] < FLATNESS * spread[1])


def resting_height(positions: np.ndarray) -> float:
    """The median height of its nodes [N, 3], all of which lie on the table."""
    return float(np.median(positions[:, 2].astype(np.float64)))


def model_of(shape: RestShape, value: Mapping[str, float], ground_height: float) -> ObjectModel:
    """The model at searched values."""
    value = {**OF_TABLE, **value}
    own = {name: value[name] for name in AS_SEARCHED if name in value}
    own["collision_distance"] = value["collision_distance"] * shape.spacing
    rests_at = resting_height(shape.positions) - ground_height if shape.lies else HALF_THICKNESS
    return spring_model(shape, value, own, bends=True, rests_at=rests_at)


def fitted_parameters(model: ObjectModel) -> tuple[FittedParameter, ...]:
    """Its springs, how it bends, how that is damped and how it wrinkles; of one that hangs its drag, too.

    How bending springs are damped beside the others is assumed when a sheet that lies is built, rather too much: a
    twin that may damp them less takes nothing for less damping that is only this (a swing that went on for 5 s ended
    in its twin after one). More than assumed is an effect.
    """
    node_mass = model.parameters.total_mass / len(model.graph.positions)
    assumed = max(model.parameters.bending_damping_ratio, PhysicalParameters.bending_damping_ratio)
    in_air = (fitted("drag", 0.0, 20.0, 0.2, unit="1/s"),) if model.parameters.drag > 0.0 else ()
    return (
        *fitted_of_springs(model, most_damping=MOST_DAMPING),
        stiffness_of_springs("bending stiffness", SpringKind.BENDING, 1.0 * node_mass, 1e5 * node_mass),
        fitted("compression_ratio", 0.05, 1.0, 0.3, logarithmic=True),
        fitted("bending_damping_ratio", 0.02, assumed, 0.5, logarithmic=True),
        *in_air,
    )


def wrinkling(model: ObjectModel) -> list[ObjectModel]:
    """The sheet with springs that give way when they are pressed."""
    return [replace(model, parameters=replace(model.parameters, compression_ratio=SIZES.compression_ratio))]


KIND = Kind(
    name=NAME,
    from_surface=FromSurface(
        recognises=looks_flat, searched=SEARCHED, searched_hanging=SEARCHED_HANGING, model=model_of
    ),
    resting_height=resting_height,
    lies_flat=True,
    fitted=fitted_parameters,
    otherwise_at_rest=wrinkling,
    variants=lambda model: spring_variants(model, SIZES),
    faces=lambda graph: faces_of_sheet(graph.positions),
    across=nodes_across,
)
