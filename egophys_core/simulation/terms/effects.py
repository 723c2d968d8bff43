"""What a kernel with effects is composed of, and what the functions of effects read."""

from dataclasses import dataclass

import warp as wp

from egophys_core.lanes import Lanes

ABSENT = -1
"""Column of an effect that no rollout of a lane group has."""

NO_LAW, SEVERAL_LAWS = -1, -2
"""In place of the one spring law of a lane group."""

LAW_NUMBERS = 4
"""Numbers of a spring law, the last ones of which may be unused."""


@dataclass(frozen=True, kw_only=True)
class EffectTerms:
    """The functions that a kernel is composed of beside those of the base simulator."""

    forces: tuple[tuple[str, wp.Function], ...]
    """Node forces, with the names of their effects."""
    laws: tuple[tuple[str, wp.Function, int], ...]
    """Spring laws, with names and with how much a spring remembers."""


@wp.struct
class EffectArrays:
    """What the functions of effects read."""

    numbers: wp.array2d(dtype=Lanes)
    """[G, P] numbers of all effects of the batch side by side."""
    columns: wp.array2d(dtype=int)
    """[G, T] column of the first number of each force, then of each law, of the kernel; `ABSENT` if none has it."""
    slots: wp.array(dtype=int)
    """[L] first number of each law in what springs remember."""
    law: wp.array(dtype=int)
    """[G] the one law that acts in each lane group, `NO_LAW` or `SEVERAL_LAWS`."""
