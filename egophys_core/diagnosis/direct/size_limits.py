"""How large an effect must be to show in what was measured: every size, from no effect towards both of its bounds."""

from collections.abc import Callable, Sequence

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.least_size import least_share
from egophys_core.effects import Effect, effect_named

NARROWINGS = 8
"""Bisections of a limit."""

Gain = Callable[[Effect, str, float], float]
"""From an effect, the name of one of its sizes and how far that is off no effect to a gain in log-likelihood."""


def size_limits(names: Sequence[str], gain: Gain, *, needed: float, one_thing: bool) -> list[DetectionLimit]:
    """The limit of every size of some effects; the larger one of both ways.

    Args:
        names: of effects.
        gain: what a size gains.
        needed: gain from which an effect shows.
        one_thing: whether effects that are one thing where they are horizontal look alike there.
    """
    found = []
    for effect in map(effect_named, names):
        for parameter in effect.parameters:
            null = parameter.null
            if null is None:
                continue
            ends = [end - null for end in (parameter.low, parameter.high) if end != null]
            sizes = [_least(effect, parameter.name, end, gain, needed) for end in ends]
            shown = [each for each in sizes if each is not None]
            found.append(
                DetectionLimit(
                    effect=effect.name,
                    parameter=parameter.name,
                    unit=parameter.unit,
                    null=null,
                    size=max(shown) if len(shown) == len(sizes) else None,
                    alike=tuple(name for name in effect.traits.equivalent_to if one_thing and name in names),
                )
            )
    return found


def _least(effect: Effect, size: str, end: float, gain: Gain, needed: float) -> float | None:
    """How far off no effect towards a bound a size must be to gain what is needed; None where it does not do there."""
    share = least_share(lambda part: gain(effect, size, part * end), needed, narrowings=NARROWINGS)
    return None if share is None else abs(end) * share
