"""What CMA-ES searches: the paper's two parameterisations in normalised coordinates (App. B.2)."""

from dataclasses import dataclass

import numpy as np

from egophys_core.kinds.rest_shape import RestShape
from egophys_core.twin import (
    ObjectKind,
    ObjectModel,
    PhysicalParameters,
    SpringGraph,
    SpringKind,
    bridge_components,
    connect,
    per_kind,
    resting_height,
)

TOTAL_MASS = 0.1
"""kg. Motion alone does not tell the mass; forces are found for this one."""

SHEET_NAMES = (
    "bending_ratio",
    "strain_limit",
    "ground_projection",
    "contact_threshold",
    "collision_restitution",
    "collision_friction",
)
"""Parameters of sheets that are searched as they are."""

BENDING_REACH = (1.4, 2.2)
"""Bending springs are this many object radii long (longer-range springs of the paper)."""

BENDING_NEIGHBOURS = 8
"""Bending springs a node asks for."""


@dataclass(frozen=True, kw_only=True)
class Searched:
    """One searched number: normalised u in 0..1 is low (high / low)^u or low + u (high - low)."""

    name: str
    low: float
    high: float
    start: float
    logarithmic: bool = False

    def value(self, u: float) -> float:
        """The number at normalised coordinate u."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** u)
        return float(self.low + u * (self.high - self.low))

    @property
    def start_u(self) -> float:
        """Normalised coordinate of the start."""
        if self.logarithmic:
            return float(np.log(self.start / self.low) / np.log(self.high / self.low))
        return (self.start - self.low) / (self.high - self.low)


def searched_numbers(kind: ObjectKind) -> tuple[Searched, ...]:
    """The coarse parameters of a kind of object.

    Rates are per node mass, lengths in units of the node spacing, so that one range serves all sizes. Stiffer or more
    damped springs than these ask for more substeps and fit no better (docs/notes/coarse_fit.md).
    """
    common = (
        Searched(name="stiffness_rate", low=1e3, high=1e5, start=3e4, logarithmic=True),
        # A sheet's bending springs have 20 times the dashpot.
        Searched(
            name="damping_rate", low=0.03, high=5.0 if kind == ObjectKind.SHEET else 30.0, start=1.0, logarithmic=True
        ),
        Searched(name="object_radius", low=1.0, high=3.0, start=1.5),
        Searched(name="object_neighbours", low=4.0, high=20.0, start=10.0),
        Searched(name="controller_radius", low=0.5, high=4.0, start=2.0),
        Searched(name="controller_neighbours", low=1.0, high=30.0, start=20.0),
        Searched(name="restitution", low=0.0, high=0.8, start=0.1),
        Searched(name="friction", low=0.0, high=1.5, start=0.5),
    )
    if kind == ObjectKind.SOLID:
        return (*common, Searched(name="drag", low=0.01, high=20.0, start=0.3, logarithmic=True))
    return (
        *common,
        Searched(name="bending_ratio", low=1e-3, high=1.0, start=0.05, logarithmic=True),
        Searched(name="strain_limit", low=0.02, high=1.0, start=0.5, logarithmic=True),
        Searched(name="ground_projection", low=0.0, high=1.0, start=0.1),
        Searched(name="contact_threshold", low=0.0, high=0.01, start=0.002),
        Searched(name="collision_distance", low=0.5, high=1.0, start=0.75),
        Searched(name="collision_restitution", low=0.0, high=0.8, start=0.1),
        Searched(name="collision_friction", low=0.0, high=1.5, start=0.3),
    )


def candidate(shape: RestShape, coordinates: np.ndarray, *, ground_height: float) -> ObjectModel:
    """The model at normalised coordinates [D] in 0..1 of `searched_numbers(shape.kind)`."""
    numbers = searched_numbers(shape.kind)
    value = {number.name: number.value(u) for number, u in zip(numbers, coordinates, strict=True)}
    node_mass = TOTAL_MASS / len(shape.positions)
    sheet = shape.kind == ObjectKind.SHEET
    stiffness = value["stiffness_rate"] * node_mass
    extra = (
        {name: value[name] for name in SHEET_NAMES}
        | {"collision_distance": value["collision_distance"] * shape.spacing}
        if sheet
        else {"drag": value["drag"], "strain_limit": 1e6, "ground_projection": 0.0}
    )
    graph = build_graph(
        shape, radius=value["object_radius"] * shape.spacing, max_neighbours=round(value["object_neighbours"])
    )
    parameters = PhysicalParameters(
        total_mass=TOTAL_MASS,
        stiffness=stiffness,
        damping=value["damping_rate"] * node_mass,
        restitution=value["restitution"],
        friction=value["friction"],
        contact_radius=max(0.0, resting_height(shape.kind, shape.positions) - ground_height),
        controller_stiffness=stiffness,
        controller_radius=value["controller_radius"] * shape.spacing,
        controller_neighbours=round(value["controller_neighbours"]),
        **extra,
    )
    return ObjectModel(
        kind=shape.kind,
        graph=graph,
        parameters=parameters,
        stiffness=per_kind(graph, parameters.stiffness, parameters.bending_ratio),
    )


def build_graph(shape: RestShape, *, radius: float, max_neighbours: int) -> SpringGraph:
    """Structural springs within a radius, in one piece; for sheets bending springs beyond it."""
    positions = shape.positions.astype(np.float64)
    structural = bridge_components(positions, connect(positions, radius=radius, max_neighbours=max_neighbours))
    bending = np.zeros((0, 2), np.int32)
    if shape.kind == ObjectKind.SHEET:
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
