"""Traits of an effect: all that a diagnosis knows of it besides its parameters and what it does."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from egophys_core.effects.effect_values import Values


class Need(StrEnum):
    """What must be in an episode for an effect to act, or to be told from others."""

    TABLE = "table"
    """The object touches a table."""
    SPRINGS = "springs"
    """The object resists by springs that stretch; those of a rod hardly do."""
    THIN = "thin"
    """The object is thin, and moves air along its normal."""
    FINE_NODES = "fine nodes"
    """The twin's nodes are close together for its size: a grip of few nodes that are far apart turns elsewhere than the
    hand."""
    MOVING_GRIP = "moving grip"
    """What holds the object moves: of a clamp that stands still it is how the clamp was mounted."""


class Measurement(StrEnum):
    """How an effect can be measured directly, without a twin."""

    GRIPS = "grips"
    """What is held moves with the hand."""
    TABLE_LEVEL = "table level"
    """A sheet that lies flat is level."""
    PLUMB_LINE = "plumb line"
    """A sheet that hangs at rest hangs along it."""
    FREE_FALL = "free fall"
    """Nothing but gravity, the air and what acts on all of it moves an object that nobody holds."""
    RING_DOWN = "ring-down"
    """The middle of a ring-down in a clamp that stands still sinks as the material relaxes."""


def never(*_: object) -> bool:
    """No, whatever the values are."""
    return False


@dataclass(frozen=True, kw_only=True)
class Traits:
    """What an effect is beside others; of names of effects each is one of the library."""

    confounders: tuple[str, ...]
    """Effects it is commonly taken for."""
    experiment: str
    """What to do to tell it from those."""
    special_cases: tuple[str, ...] = ()
    """Effects that it contains, or comes near to. Of both the special case is named, unless this explains more."""
    equivalent_to: tuple[str, ...] = ()
    """Effects that are one thing with it where both are horizontal: neither is the simpler."""
    equivalent_in_air: tuple[str, ...] = ()
    """Effects that are one thing with it where no table lies aslant, too."""
    needs: frozenset[Need] = frozenset()
    measured_by: tuple[Measurement, ...] = ()
    """How it is measured directly, if it can be; where several tell, the first one counts."""
    same_in_every_motion: bool = False
    """Whether it belongs to the surroundings: episodes that ask for different sizes, of which one makes another worse,
    refute it. An added mass's place and size make up for each other, and a grip slips as it was taken."""
    is_event: bool = False
    """Whether it happens or not: a grip that slips in some episodes need not slip in others."""
    degenerate_parameter: str | None = None
    """A parameter at whose bounds it is no longer itself: what relaxes at once is a damper, which a twin has."""
    common_in: frozenset[str] = frozenset()
    """Kinds of objects in which it is refitted whatever its slopes say."""
    is_horizontal: Callable[[Values], bool] = never
    """Whether, with these values, it is a steady force to the side."""
    is_vertical: Callable[[Values], bool] = never
    """Whether, with these values, it says only that an object hangs lower or higher."""
    is_implausible: Callable[[Values, np.ndarray], bool] = never
    """Whether values, for an object at rest at [N, 3] metres, are of no such thing: an added mass where nothing is."""
