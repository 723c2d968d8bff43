"""The library: one file per physical or measurement effect that a twin may lack."""

import difflib

from egophys_core.effects import (
    anisotropy,
    bending_damping,
    constant_body_force,
    control_delay,
    grasp_slip,
    gravity_scale,
    gravity_tilt,
    gripper_offset,
    hidden_tether,
    hysteresis,
    place_dependent_friction,
    plasticity,
    point_attraction,
    quadratic_drag,
    strain_stiffening,
    stribeck_friction,
    table_adhesion,
    tension_compression_asymmetry,
    time_varying_body_force,
    tracking_offset,
    tracking_rotation,
    tracking_scale,
    uneven_mass,
    viscoelasticity,
)
from egophys_core.effects.effect import Effect, Parameter, Surroundings, TwinEffect
from egophys_core.errors import TwinError

LIBRARY: dict[str, Effect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        quadratic_drag,
        constant_body_force,
        time_varying_body_force,
        gravity_scale,
        gravity_tilt,
        point_attraction,
        hidden_tether,
        table_adhesion,
        place_dependent_friction,
        stribeck_friction,
        uneven_mass,
        strain_stiffening,
        tension_compression_asymmetry,
        anisotropy,
        bending_damping,
        viscoelasticity,
        plasticity,
        hysteresis,
        grasp_slip,
        control_delay,
        tracking_scale,
        tracking_rotation,
        tracking_offset,
        gripper_offset,
    )
}
"""All effects by name."""

__all__ = ["LIBRARY", "Effect", "Parameter", "Surroundings", "TwinEffect", "effect_named"]


def effect_named(name: str) -> Effect:
    """The effect of a name.

    Raises:
        TwinError: the library has none of that name.
    """
    if name not in LIBRARY:
        near = difflib.get_close_matches(name, LIBRARY, n=1)
        hint = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(sorted(LIBRARY))}"
        raise TwinError(f"no effect is called {name!r}{hint}")
    return LIBRARY[name]
