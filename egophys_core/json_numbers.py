"""Numbers that JSON does not have."""

import math
from collections.abc import Mapping
from typing import Any


def nulled(value: Any) -> Any:
    """A value of mappings, lists and tuples, at any depth, with None for floats that are not finite."""
    if isinstance(value, Mapping):
        return {key: nulled(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [nulled(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
