"""Numbers that JSON does not have, and those that floats do not."""

import math
from collections.abc import Mapping
from numbers import Real
from typing import Any


def nulled(value: Any) -> Any:
    """A value of mappings, lists and tuples, at any depth, with None for floats that are not finite."""
    if isinstance(value, Mapping):
        return {key: nulled(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [nulled(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finite_number(value: Any) -> float | None:
    """A real number as a float; None for what is none, or beyond all floats: JSON's numbers have any length."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
