"""Objects of springs between near nodes: their graph, what is searched of all of them, and their variants."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from egophys_core.effects.effect import Parameter
from egophys_core.geometry import spacing
from egophys_core.kinds.kind import FittedParameter, RestShape, Searched
from egophys_core.twin import (
    ObjectModel,
    PhysicalParameters,
    SpringGraph,
    SpringKind,
    bridge_components,
    connect,
    per_kind,
)

TOTAL_MASS = 0.1
"""kg. Motion alone does not tell the mass; forces are found for this one."""

BENDING_REACH = (1.4, 2.2)
"""Bending springs are this many object radii long (longer-range springs of the paper)."""

BENDING_NEIGHBOURS = 8
"""Bending springs a node asks for."""

STIFFEST = 1e6
"""1/s^2, largest spring stiffness over node mass: a held toy may not sag where the real one does not."""

GRASP_RADII = (1.0, 2.0, 3.0)
"""Of variants, in units of the node spacing."""

NEIGHBOURS = 24
"""Springs that a node of a variant asks for: all within the radius."""

GRASP_NEIGHBOURS = 60
"""Most nodes that a controller point holds: all within its radius, but of very dense ones."""

SOFTER = (1.0, 0.25)
"""Times the stiffness of its kind at which a variant may begin."""


def searched_of_springs(*, most_damping: float) -> tuple[Searched, ...]:
    """What is searched of every object of springs.

    Rates are per node mass, lengths in units of the node spacing, so that one range serves all sizes. Stiffer or more
    damped springs than these ask for more substeps and fit no better (docs/notes/coarse_fit.md).

    Args:
        most_damping: dashpot over node mass, 1/s.
    """
    return (
        Searched(name="damping_rate", low=0.03, high=most_damping, start=1.0, logarithmic=True),
        Searched(name="restitution", low=0.0, high=0.8, start=0.1),
        Searched(name="friction", low=0.0, high=1.5, start=0.5),
    )


def spring_model(
    shape: RestShape, value: Mapping[str, float], further: Mapping[str, Any], *, bends: bool, rests_at: float
) -> ObjectModel:
    """The model of a shape at the values of `searched_of_springs`.

    Args:
        further: parameters of its kind.
        bends: whether it has bending springs.
        rests_at: metres above the table at which it touches it.
    """
    node_mass = TOTAL_MASS / len(shape.positions)
    stiffness = value["stiffness_rate"] * node_mass
    graph = spring_graph(
        shape,
        radius=value["object_radius"] * shape.spacing,
        max_neighbours=round(value["object_neighbours"]),
        bends=bends,
    )
    parameters = PhysicalParameters(
        total_mass=TOTAL_MASS,
        stiffness=stiffness,
        damping=value["damping_rate"] * node_mass,
        restitution=value["restitution"],
        friction=value["friction"],
        contact_radius=max(0.0, rests_at),
        controller_stiffness=stiffness,
        controller_radius=shape.grasp_radius,
        controller_neighbours=GRASP_NEIGHBOURS,
        **further,
    )
    return ObjectModel(
        kind=shape.kind,
        graph=graph,
        parameters=parameters,
        stiffness=per_kind(graph, parameters.stiffness, parameters.bending_ratio),
    )


def spring_graph(shape: RestShape, *, radius: float, max_neighbours: int, bends: bool) -> SpringGraph:
    """Structural springs within a radius, in one piece, and bending springs beyond it for what has them."""
    positions = shape.positions.astype(np.float64)
    structural = bridge_components(positions, connect(positions, radius=radius, max_neighbours=max_neighbours))
    bending = np.zeros((0, 2), np.int32)
    if bends:
        bending = connect(
            positions,
            radius=BENDING_REACH[1] * radius,
            inner_radius=BENDING_REACH[0] * radius,
            max_neighbours=BENDING_NEIGHBOURS,
        )
        taken = {tuple(pair) for pair in structural.tolist()}
        bending = np.array([pair for pair in bending.tolist() if tuple(pair) not in taken], np.int32).reshape(-1, 2)
    springs = np.concatenate([structural, bending])
    lengths = np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1)
    return SpringGraph(
        positions=shape.positions,
        springs=springs,
        kinds=np.repeat(
            np.array([SpringKind.STRUCTURAL, SpringKind.BENDING], np.uint8), [len(structural), len(bending)]
        ),
        rest_lengths=lengths.astype(np.float32),
        surface=shape.surface,
    )


def fitted_of_springs(model: ObjectModel, *, most_damping: float) -> tuple[FittedParameter, ...]:
    """What is fitted anew of every object of springs.

    Args:
        most_damping: dashpot over node mass, 1/s.
    """
    node_mass = model.parameters.total_mass / len(model.graph.positions)
    # A template of a stiff material is built beyond these bounds; they then move with it.
    room = max(1.0, 3.0 * model.parameters.stiffness / (STIFFEST * node_mass))
    low, high = 1e2 * node_mass, room * STIFFEST * node_mass
    return (
        stiffness_of_springs("stiffness", SpringKind.STRUCTURAL, low, high),
        fitted("damping", 0.01 * node_mass, room * most_damping * node_mass, 0.5, unit="N s/m", logarithmic=True),
        fitted("friction", 0.0, 2.0, 0.05),
        fitted("controller_stiffness", low, high, 0.5, unit="N/m", logarithmic=True),
    )


def fitted(
    name: str, low: float, high: float, step: float, *, unit: str = "1", logarithmic: bool = False
) -> FittedParameter:
    """One of the physical parameters."""
    return FittedParameter(
        parameter=Parameter(name=name, unit=unit, low=low, high=high, step=step, logarithmic=logarithmic)
    )


def stiffness_of_springs(name: str, springs: SpringKind, low: float, high: float) -> FittedParameter:
    """The median stiffness of some springs, N/m."""
    return FittedParameter(
        parameter=Parameter(name=name, unit="N/m", low=low, high=high, step=0.3, logarithmic=True), springs=springs
    )


@dataclass(frozen=True, kw_only=True)
class VariantSizes:
    """Where variants of a kind begin."""

    object_radii: tuple[float, ...]
    """In units of the node spacing."""
    stiffness_rate: float
    """Of a structural spring over node mass at twice the spacing, 1/s^2: stiff, as cloth and toys are."""
    damping_rate: float
    """Dashpot over node mass, 1/s."""
    bending_ratios: tuple[float, ...]
    """Stiffness of bending springs over that of the others."""
    compression_ratio: float
    """Of springs that are pressed over springs that are pulled."""
    collides: bool
    bends: bool
    """Whether it has bending springs."""


def spring_variants(model: ObjectModel, sizes: VariantSizes) -> list[list[ObjectModel]]:
    """The object with graphs and grasps of other sizes, and for each of these some plain parameters."""
    graph, parameters = model.graph, model.parameters
    surface = graph.positions[graph.surface].astype(np.float64)
    apart = spacing(surface)
    shape = RestShape(positions=graph.positions, surface=graph.surface, kind=model.kind, spacing=apart)
    node_mass = parameters.total_mass / len(graph.positions)

    def variant(other: SpringGraph, radius: float, grasp: float, softer: float, bending: float) -> ObjectModel:
        # Springs share the load: more of them, each softer.
        stiffness = softer * sizes.stiffness_rate * node_mass * (2.0 / radius) ** 2
        plain = replace(
            parameters,
            stiffness=stiffness,
            damping=sizes.damping_rate * node_mass,
            bending_ratio=bending,
            strain_limit=1e6,
            compression_ratio=sizes.compression_ratio,
            ground_projection=0.0,
            restitution=0.0,
            friction=0.5,
            controller_stiffness=stiffness,
            controller_radius=grasp * apart,
            controller_neighbours=GRASP_NEIGHBOURS,
            collision_distance=0.6 * apart if sizes.collides else 0.0,
        )
        return replace(
            model, graph=other, parameters=plain, stiffness=per_kind(other, plain.stiffness, plain.bending_ratio)
        )

    found = []
    for radius in sizes.object_radii:
        other = spring_graph(shape, radius=radius * apart, max_neighbours=NEIGHBOURS, bends=sizes.bends)
        found += [
            [
                variant(other, radius, grasp, softer, bending)
                for softer, bending in product(SOFTER, sizes.bending_ratios)
            ]
            for grasp in GRASP_RADII
        ]
    return found
