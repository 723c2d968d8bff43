"""PhysicalParameters: the numbers a twin has besides its graph."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.errors import TwinError
from egophys_core.json_numbers import finite_number

INTRINSIC_CURVATURE = ("intrinsic_curvature_level", "intrinsic_curvature_up")

LEAST_MASS = 1e-9
"""kg: far less than any object has, and nodes that share it still divide forces in single precision."""

SIGNED = (*INTRINSIC_CURVATURE, "far_roll")
"""Parameters of a rod, which alone may be negative."""

FORMER_NAMES = {"intrinsic_curvature_level": "natural_bend_level", "intrinsic_curvature_up": "natural_bend_up"}
"""What parameters were called in earlier twin files, and are called still where a twin's id is made: logs name twins by
their ids."""


@dataclass(frozen=True, kw_only=True)
class PhysicalParameters:
    """Global physical parameters of a twin (the paper's alpha), SI units.

    Point tracks determine forces per mass only, so the total mass is a scale that is chosen, not fitted;
    stiffness and damping come out for that mass.
    """

    total_mass: float = 0.1
    """Mass of the object, kg; shared equally by the nodes."""
    stiffness: float
    """Stiffness of a structural spring, N/m (the paper's k-bar)."""
    bending_ratio: float = 0.1
    """Stiffness of a bending spring over that of a structural one."""
    damping: float
    """Dashpot of a structural spring, N s/m (gamma of the paper's force equation)."""
    bending_damping_ratio: float = 20.0
    """Dashpot of a bending spring over that of a structural one."""
    drag: float = 0.0
    """Velocity decay against the world, 1/s: every node feels -drag * mass * velocity."""
    added_mass: float = 0.0
    """Of a sheet: mass of the air that it carries along its normal, over its own."""
    strain_limit: float = 0.5
    """Tensile strain beyond which a structural spring softens (paper, strain-limiting equation)."""
    compression_ratio: float = 1.0
    """Stiffness of a spring that is pressed over that of one that is pulled, 0..1: cloth wrinkles between its nodes."""
    flexural_rigidity: float = 0.0
    """Of a rod: bending moment over curvature, N m^2 (E I)."""
    retardation_time: float = 0.0
    """Of a rod, seconds: a moment of this times the flexural rigidity times the rate of curvature damps its bending."""
    intrinsic_curvature_level: float = 0.0
    """Of a rod, 1/m: its curvature when nothing acts on it, to its level left (`level_axes`)."""
    intrinsic_curvature_up: float = 0.0
    """The same, to above."""
    far_roll: float = 0.0
    """Of a rod, radians: how its far clamp holds it turned about its line, beyond the near one."""
    restitution: float = 0.0
    """Share of the normal speed kept in a bounce off the table, 0..1."""
    friction: float = 0.5
    """Coulomb friction coefficient against the table."""
    ground_projection: float = 0.0
    """Share of an upward net force removed within the contact band (alpha_g of the paper), 0..1."""
    contact_threshold: float = 0.005
    """Height of the contact band above the table, metres (delta_c of the paper)."""
    contact_radius: float = 0.0
    """Distance of a node's centre from the surface it stands for, metres; it touches the table at this height."""
    collision_distance: float = 0.0
    """Nodes of a sheet that come nearer to each other than this collide, metres; 0 for no self-collision."""
    collision_restitution: float = 0.0
    """Share of the approach speed kept in a self-collision, 0..1."""
    collision_friction: float = 0.3
    """Coulomb friction coefficient of the object against itself, and against hands that press it."""
    controller_stiffness: float
    """Stiffness of a spring between a held node and a controller point, N/m."""
    controller_radius: float = 0.03
    """Nodes within this distance of a controller point are held when it takes hold, metres (r_c)."""
    controller_neighbours: int = 10
    """Most nodes a controller point holds."""
    gravity: float = GRAVITY
    """Downward acceleration, m/s^2."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if finite_number(value) is None or (value < 0 and field.name not in SIGNED):
                raise TwinError(f"{field.name} must be finite and not negative, got {value!r}")
        if self.total_mass < LEAST_MASS:
            raise TwinError(f"total_mass must be at least {LEAST_MASS:g} kg, got {self.total_mass:g}")
        if not isinstance(self.controller_neighbours, int | np.integer) or self.controller_neighbours < 1:
            raise TwinError(f"controller_neighbours must be an integer from 1 on, got {self.controller_neighbours}")
        for name in ("stiffness", "controller_radius"):
            if getattr(self, name) == 0:
                raise TwinError(f"{name} must be positive, got 0")
        for name in ("compression_ratio", "restitution", "ground_projection", "collision_restitution"):
            if getattr(self, name) > 1:
                raise TwinError(f"{name} must be in 0..1, got {getattr(self, name)}")


LATER = ("added_mass", "far_roll")
"""Parameters that came later: those of twins of before are 0, and no part of their ids."""


def with_former_names(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by the names that they had first, without later ones that are 0."""
    return {FORMER_NAMES.get(name, name): value for name, value in values.items() if value or name not in LATER}


def with_present_names(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a twin file, of whatever age, by their names of now."""
    present = {former: name for name, former in FORMER_NAMES.items()}
    return {present.get(name, name): value for name, value in values.items()}
