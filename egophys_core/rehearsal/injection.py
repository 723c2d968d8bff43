"""The effects that can be injected into the rehearsal world: parameters at two sizes, and the check of a request.

Names and units are those of the library's effect of the same name, so that injected and found values stand side by
side. The world has its own laws all the same: where one of them is not the library's, the docstring of its force says
what of it a parameter measures.
"""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass

from egophys_core.errors import OptionsError

Effects = dict[str, dict[str, float]]
"""Complete parameters of injected effects, by effect and parameter name."""

LATEST = 60.0
"""Seconds: lasts to the end of every episode."""


@dataclass(frozen=True, kw_only=True)
class InjectableEffect:
    """An effect of the library as the rehearsal world does it."""

    equation: str
    """What happens, in the words and symbols of the parameters."""
    units: Mapping[str, str]
    """By parameter; "1" for a pure number."""
    small: Mapping[str, float]
    """A size that moves the points by some millimetres."""
    large: Mapping[str, float]
    """A size that anyone would see."""


def _effect(equation: str, **parameters: tuple[str, float, float]) -> InjectableEffect:
    """Parameters as (unit, small, large)."""
    return InjectableEffect(
        equation=equation,
        units={name: each[0] for name, each in parameters.items()},
        small={name: each[1] for name, each in parameters.items()},
        large={name: each[2] for name, each in parameters.items()},
    )


INJECTABLE: dict[str, InjectableEffect] = {
    "quadratic_drag": _effect("a = -coefficient |v| v", coefficient=("1/m", 5.0, 14.0)),
    "constant_body_force": _effect(
        "a = (x, y, z)", x=("m/s^2", 0.4, 1.5), y=("m/s^2", 0.2, 0.8), z=("m/s^2", 0.0, 0.0)
    ),
    "time_varying_body_force": _effect(
        "a = (x, y, z) cos(2 pi frequency (t - onset) - phase) for onset < t < onset + duration",
        x=("m/s^2", 0.8, 2.5),
        y=("m/s^2", 0.3, 1.0),
        z=("m/s^2", 0.0, 0.0),
        onset=("s", 2.0, 2.0),
        duration=("s", LATEST, LATEST),
        frequency=("Hz", 0.5, 0.5),
        phase=("rad", math.pi / 2.0, math.pi / 2.0),
    ),
    "added_mass": _effect("(m + ratio m n n^T) a = F, n the normal of a sheet", ratio=("1", 0.3, 1.0)),
    "gravity_scale": _effect("a = -scale g z", scale=("1", 0.85, 0.6)),
    "gravity_tilt": _effect(
        "a = -g R z, R of the rotation vector (about_x, about_y, 0)",
        about_x=("rad", 0.030008, 0.100281),
        about_y=("rad", 0.039988, 0.129565),
    ),
    "point_attraction": _effect(
        "a = strength (d / range) exp((1 - |d|^2 / range^2) / 2), d = (x, y, z) - position",
        x=("m", 0.1, 0.1),
        y=("m", 0.15, 0.15),
        z=("m", 0.15, 0.15),
        strength=("m/s^2", 0.727837, 3.032653),
        range=("m", 0.15, 0.15),
    ),
    "hidden_tether": _effect(
        "F / M = stiffness (|d| - length) d / |d| when |d| > length, d = (x, y, z) on the resting object "
        "+ (anchor_x, anchor_y, 0) - where that place is now",
        x=("m", -0.05, -0.05),
        y=("m", 0.03, 0.03),
        z=("m", 0.005, 0.005),
        anchor_x=("m", -0.1, -0.1),
        anchor_y=("m", 0.07, 0.07),
        stiffness=("1/s^2", 7.0, 30.0),
        length=("m", 0.12, 0.12),
    ),
    "table_adhesion": _effect(
        "a_z = -strength u exp(1 - u), u = height above the height of contact / reach",
        strength=("m/s^2", 5.88, 23.52),
        reach=("m", 0.003, 0.003),
    ),
    "place_dependent_friction": _effect(
        "mu (1 + change) within radius of (x, y), else mu",
        x=("m", 0.12, 0.12),
        y=("m", -0.05, -0.05),
        radius=("m", 0.1, 0.1),
        change=("1", 0.7, 2.5),
    ),
    "stribeck_friction": _effect(
        "mu(v) = mu (1 + rise exp(-(v / speed)^2))", rise=("1", 0.6, 2.0), speed=("m/s", 0.03, 0.03)
    ),
    "uneven_mass": _effect(
        "added mass of fraction times the object's about (x, y, z) from the centre of the resting object",
        x=("m", -0.05, -0.05),
        y=("m", 0.02, 0.02),
        z=("m", -0.022, -0.022),
        radius=("m", 0.02, 0.02),
        fraction=("1", 0.25, 0.85),
    ),
    "strain_stiffening": _effect("stress = E (e + coefficient e^3)", coefficient=("1", 82.0, 410.0)),
    "tension_compression_asymmetry": _effect(
        "E in tension, E (1 + change) in compression", change=("1", -0.138, -0.333)
    ),
    "anisotropy": _effect(
        "E(angle) = E (1 + cosine cos 2 angle + sine sin 2 angle), angle from the x axis at rest",
        cosine=("1", 0.0397, 0.0956),
        sine=("1", 0.1021, 0.2458),
    ),
    "bending_damping": _effect(
        "bending is damped factor times as much as the material damps it", factor=("1", 21.0, 67.7)
    ),
    "viscoelasticity": _effect(
        "stress = E e + ratio E (e - q), dq/dt = (e - q) / time", ratio=("1", 0.14, 0.4), time=("s", 1.0, 1.0)
    ),
    "plasticity": _effect(
        "dp/dt = flow (|e - p| - yield_strain) sign(e - p) beyond the yield strain",
        flow=("1/s", 5.0, 5.0),
        yield_strain=("1", 0.03, 0.01),
    ),
    "hysteresis": _effect(
        "stress = E (e + strength strain z), dz = (1 - |z| (1 + sign(z de)) / 2) de / strain (Bouc-Wen, n = 1)",
        strength=("1", 0.16, 0.5),
        strain=("1", 0.01, 0.01),
    ),
    "grasp_slip": _effect(
        "what is held slides through the hand at (x, y, z) after the onset, z along its pull",
        x=("m/s", 0.0, 0.0),
        y=("m/s", 0.0, 0.0),
        z=("m/s", -0.003, -0.012),
        onset=("s", 2.5, 2.5),
    ),
    "control_delay": _effect("the hands follow their record delay later", delay=("s", 0.05, 0.15)),
    "tracking_scale": _effect("object points p_recorded = scale p", scale=("1", 0.96, 0.88)),
    "tracking_rotation": _effect(
        "points of object and hands p_recorded = R p, R of the rotation vector (about_x, about_y, 0)",
        about_x=("rad", 0.029592, 0.077367),
        about_y=("rad", 0.020595, 0.053916),
    ),
    "tracking_offset": _effect(
        "object points p_recorded = p + (x, y, z)",
        x=("m", 0.006, 0.015),
        y=("m", -0.004, -0.01),
        z=("m", 0.004, 0.012),
    ),
    "gripper_offset": _effect(
        "the hands are at their record + (x, y, z)", x=("m", -0.01, -0.025), y=("m", 0.006, 0.015), z=("m", 0.004, 0.01)
    ),
}
"""By the name the library has for it."""


def injected_sizes(name: str) -> dict[str, dict[str, float]]:
    """All parameters of an effect, `{"small": ..., "large": ...}`.

    Raises:
        OptionsError: no such effect; suggests the nearest.
    """
    effect = _effect_named(name)
    return {"small": dict(effect.small), "large": dict(effect.large)}


def complete_effects(effects: Mapping[str, Mapping[str, float]]) -> Effects:
    """The effects with every parameter; those not given are the small size's.

    Raises:
        OptionsError: an effect or parameter is unknown (suggests the nearest), a value is not a finite number.
    """
    complete: Effects = {}
    for name, given in effects.items():
        effect = _effect_named(name)
        for parameter, value in given.items():
            if parameter not in effect.units:
                raise OptionsError(_unknown(f"parameter of {name}", parameter, effect.units))
            if not math.isfinite(value):
                raise OptionsError(f"{name}: {parameter} must be a finite number, got {value}")
        complete[name] = {**effect.small, **given}
    return complete


def _effect_named(name: str) -> InjectableEffect:
    if name not in INJECTABLE:
        raise OptionsError(_unknown("effect", name, INJECTABLE))
    return INJECTABLE[name]


def _unknown(what: str, name: str, known: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.0)
    return f"unknown {what} {name!r}; did you mean {near[0]!r}? There are {', '.join(known)}"
