"""The effects that can be planted in the rehearsal world: their numbers, at two sizes, and the check of a request."""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass

from egophys_core.errors import OptionsError

Effects = dict[str, dict[str, float]]
"""Complete numbers of planted effects, by effect and parameter name."""


@dataclass(frozen=True, kw_only=True)
class Plant:
    """An effect of the library as the rehearsal world does it."""

    equation: str
    """What happens, in the words and symbols of the parameters."""
    units: Mapping[str, str]
    """By parameter; "1" for a pure number."""
    small: Mapping[str, float]
    """A size that moves the points by some millimetres."""
    large: Mapping[str, float]
    """A size that anyone would see."""


def _plant(equation: str, **parameters: tuple[str, float, float]) -> Plant:
    """Parameters as (unit, small, large)."""
    return Plant(
        equation=equation,
        units={name: each[0] for name, each in parameters.items()},
        small={name: each[1] for name, each in parameters.items()},
        large={name: each[2] for name, each in parameters.items()},
    )


PLANTS: dict[str, Plant] = {
    "quadratic_drag": _plant("a = -c |v| v", c_per_kg=("1/m", 5.0, 14.0)),
    "constant_body_force": _plant(
        "a = (ax, ay, az)", ax=("m/s^2", 0.4, 1.5), ay=("m/s^2", 0.2, 0.8), az=("m/s^2", 0.0, 0.0)
    ),
    "time_varying_body_force": _plant(
        "a = (ax, ay, az) sin(2 pi f (t - onset)) after the onset",
        ax=("m/s^2", 0.8, 2.5),
        ay=("m/s^2", 0.3, 1.0),
        az=("m/s^2", 0.0, 0.0),
        frequency=("Hz", 0.5, 0.5),
        onset=("s", 2.0, 2.0),
    ),
    "gravity_scale": _plant("g' = factor g", factor=("1", 0.85, 0.6)),
    "gravity_tilt": _plant(
        "gravity turned about x, then about y", tilt_x=("rad", 0.03, 0.1), tilt_y=("rad", 0.04, 0.13)
    ),
    "point_attraction": _plant(
        "a = strength r exp(-r^2 / 2 range^2) / range towards the point, r away",
        x=("m", 0.1, 0.1),
        y=("m", 0.15, 0.15),
        z=("m", 0.15, 0.15),
        strength=("m/s^2", 1.2, 5.0),
        range=("m", 0.15, 0.15),
    ),
    "hidden_tether": _plant(
        "pulls the place (px, py, pz) on the resting object to the anchor: F = stiffness (d - length) when d > length",
        px=("m", -0.05, -0.05),
        py=("m", 0.03, 0.03),
        pz=("m", 0.005, 0.005),
        ax=("m", -0.15, -0.15),
        ay=("m", 0.1, 0.1),
        az=("m", 0.0, 0.0),
        stiffness=("N/m", 0.7, 3.0),
        length=("m", 0.12, 0.12),
    ),
    "table_adhesion": _plant(
        "stress (h / range) exp(1 - h / range) pulls down, h above the height of contact",
        stress=("Pa", 10.0, 40.0),
        range=("m", 0.003, 0.003),
    ),
    "place_dependent_friction": _plant(
        "friction with the table times factor within radius of (x, y)",
        x=("m", 0.12, 0.12),
        y=("m", -0.05, -0.05),
        radius=("m", 0.1, 0.1),
        factor=("1", 1.7, 3.5),
    ),
    "stribeck_friction": _plant(
        "mu(v) = mu (1 + rise exp(-(v / speed)^2))", rise=("1", 0.6, 2.0), speed=("m/s", 0.03, 0.03)
    ),
    "uneven_mass": _plant(
        "fraction of the object's mass more, spread within radius of (x, y, z) on the resting object",
        fraction=("1", 0.25, 0.85),
        x=("m", -0.05, -0.05),
        y=("m", 0.02, 0.02),
        z=("m", 0.03, 0.03),
        radius=("m", 0.045, 0.045),
    ),
    "strain_stiffening": _plant("T += beta strain^3 EA along every edge", beta=("1", 300.0, 1500.0)),
    "tension_compression_asymmetry": _plant("T += ratio strain EA where strain > 0", ratio=("1", 0.8, 2.5)),
    "anisotropy": _plant(
        "T += ratio strain EA cos^4 of the angle between edge and direction, at rest",
        ratio=("1", 1.0, 3.0),
        angle=("rad", 0.6, 0.6),
    ),
    "bending_damping": _plant(
        "moment = -time D of a hinge times its rate of bending, D the bending stiffness", time=("s", 0.03, 0.1)
    ),
    "viscoelasticity": _plant(
        "Maxwell arm along every edge: dT/dt = ratio EA dstrain/dt - T / tau",
        ratio=("1", 0.7, 2.0),
        tau=("s", 1.0, 1.0),
    ),
    "plasticity": _plant(
        "the rest length follows when the elastic strain exceeds the yield strain, at a rate of 1 / tau",
        yield_strain=("1", 0.03, 0.01),
        tau=("s", 0.2, 0.2),
    ),
    "hysteresis": _plant(
        "Bouc-Wen along every edge: T += ratio EA w z, w dz = (1 - |z| (0.5 sign(z dstrain) + 0.5)) dstrain",
        ratio=("1", 0.8, 2.5),
        w=("1", 0.01, 0.01),
    ),
    "grasp_slip": _plant(
        "what is held slides through the hand at rate, the way it pulls, after the onset",
        rate=("m/s", 0.003, 0.012),
        onset=("s", 2.5, 2.5),
    ),
    "control_delay": _plant("the hands follow their record delay later", delay=("s", 0.05, 0.15)),
    "tracking_scale": _plant("object points p' = scale p", scale=("1", 0.96, 0.88)),
    "tracking_rotation": _plant(
        "points of object and hands p' = R p, R of the rotation vector",
        rx=("rad", 0.03, 0.08),
        ry=("rad", 0.02, 0.05),
        rz=("rad", 0.04, 0.1),
    ),
    "tracking_offset": _plant(
        "object points p' = p + (x, y, z)", x=("m", 0.006, 0.015), y=("m", -0.004, -0.01), z=("m", 0.004, 0.012)
    ),
    "gripper_offset": _plant(
        "the hands are at their record + (x, y, z)", x=("m", -0.01, -0.025), y=("m", 0.006, 0.015), z=("m", 0.004, 0.01)
    ),
}
"""By the name the library has for it."""


def planted_sizes(name: str) -> dict[str, dict[str, float]]:
    """All parameters of an effect, `{"small": ..., "large": ...}`.

    Raises:
        OptionsError: no such effect; suggests the nearest.
    """
    plant = _plant_named(name)
    return {"small": dict(plant.small), "large": dict(plant.large)}


def complete_effects(effects: Mapping[str, Mapping[str, float]]) -> Effects:
    """The effects with every parameter; those not given are the small size's.

    Raises:
        OptionsError: an effect or parameter is unknown (suggests the nearest), a value is not a finite number.
    """
    complete: Effects = {}
    for name, given in effects.items():
        plant = _plant_named(name)
        for parameter, value in given.items():
            if parameter not in plant.units:
                raise OptionsError(_unknown(f"parameter of {name}", parameter, plant.units))
            if not math.isfinite(value):
                raise OptionsError(f"{name}: {parameter} must be a finite number, got {value}")
        complete[name] = {**plant.small, **given}
    return complete


def _plant_named(name: str) -> Plant:
    if name not in PLANTS:
        raise OptionsError(_unknown("effect", name, PLANTS))
    return PLANTS[name]


def _unknown(what: str, name: str, known: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.0)
    return f"unknown {what} {name!r}; did you mean {near[0]!r}? There are {', '.join(known)}"
