"""The library: one file per physical or measurement effect that a twin may lack.

A file is imported when its effect is asked for: those that act in the simulator bring Warp with them.
"""

import difflib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module

from egophys_core.effects.effect import Effect, Parameter, Surroundings, TwinEffect
from egophys_core.errors import TwinError

NAMES = (
    "quadratic_drag",
    "constant_body_force",
    "time_varying_body_force",
    "added_mass",
    "gravity_scale",
    "gravity_tilt",
    "point_attraction",
    "hidden_tether",
    "table_adhesion",
    "place_dependent_friction",
    "stribeck_friction",
    "uneven_mass",
    "strain_stiffening",
    "tension_compression_asymmetry",
    "anisotropy",
    "bending_damping",
    "viscoelasticity",
    "plasticity",
    "hysteresis",
    "grasp_slip",
    "control_delay",
    "tracking_scale",
    "tracking_rotation",
    "tracking_offset",
    "gripper_offset",
)
"""Effects of the library: names, and files of this room."""


class _Library(Mapping[str, Effect]):
    """The files of this room, and effects from outside."""

    def __init__(self) -> None:
        self.added: list[tuple[Effect, bool]] = []
        """With whether it is a candidate."""

    def __getitem__(self, name: str) -> Effect:
        for effect, _ in self.added:
            if effect.name == name:
                return effect
        if name not in NAMES:
            raise KeyError(name)
        found: Effect = import_module(f"egophys_core.effects.{name}").EFFECT
        return found

    def __iter__(self) -> Iterator[str]:
        return iter((*NAMES, *dict.fromkeys(effect.name for effect, candidate in self.added if candidate)))

    def __len__(self) -> int:
        return len(tuple(iter(self)))


_LIBRARY = _Library()

LIBRARY: Mapping[str, Effect] = _LIBRARY
"""All effects by name, in the order in which they are considered."""

__all__ = [
    "LIBRARY",
    "NAMES",
    "Effect",
    "Parameter",
    "Surroundings",
    "TwinEffect",
    "added",
    "effect_named",
    "general_forms",
    "nested",
]


@contextmanager
def added(effect: Effect, *, candidate: bool = True) -> Iterator[None]:
    """An effect from outside, part of the library as long as the context lasts.

    Args:
        candidate: whether a diagnosis considers it; otherwise models can carry it, and no list has it.

    Raises:
        TwinError: the library has another one of that name.
    """
    if effect.name in LIBRARY and LIBRARY[effect.name] is not effect:
        raise TwinError(f"the library has an effect {effect.name!r} already; choose another name")
    entry = (effect, candidate)
    _LIBRARY.added.append(entry)
    try:
        yield
    finally:
        _LIBRARY.added.remove(entry)


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


def general_forms(name: str) -> tuple[str, ...]:
    """Effects of the library of which one is a special case."""
    return tuple(other.name for other in LIBRARY.values() if name in other.traits.special_cases)


def nested(name: str) -> set[str]:
    """Effects that one contains, or that contain it.

    That the special case is refuted says nothing against the general one, nor the other way round.
    """
    return {*effect_named(name).traits.special_cases, *general_forms(name)}
