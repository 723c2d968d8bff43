"""Options of a room: one frozen keyword-only dataclass that feeds YAML, the command line and ROS parameters."""

import dataclasses
import difflib
from array import array
from collections.abc import Mapping
from enum import Enum
from typing import Any, TypeVar

from egophys_core.errors import OptionsError

T = TypeVar("T")


def number(default: Any, *, low: float, high: float, doc: str) -> Any:
    """A numeric option, or several in a tuple, with its range, both ends allowed.

    `doc` is shown by --help and ros2 param describe.
    """
    return dataclasses.field(default=default, metadata={"low": low, "high": high, "doc": doc})


def choice(default: Any, *, doc: str) -> Any:
    """An option that is one member of a StrEnum."""
    return dataclasses.field(default=default, metadata={"doc": doc})


def switch(default: bool, *, doc: str) -> Any:
    """An option that is on or off."""
    return dataclasses.field(default=default, metadata={"doc": doc})


def text(default: str, *, doc: str) -> Any:
    """An option that is a text, checked by its class if not all texts do."""
    return dataclasses.field(default=default, metadata={"doc": doc})


def validate(options: Any) -> None:
    """Check every numeric option of a dataclass against its range; call it from `__post_init__`.

    Raises:
        OptionsError: names the option, its value and its range.
    """
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        low, high = field.metadata.get("low"), field.metadata.get("high")
        values = value if isinstance(value, tuple) else (value,)
        if low is not None and not all(low <= each <= high for each in values):
            raise OptionsError(f"{field.name} must be in {low:g} .. {high:g}, got {value}")


def from_mapping(cls: type[T], values: Mapping[str, Any]) -> T:
    """Make options of class `cls` from names and values as they come from YAML, JSON or parameters.

    Raises:
        OptionsError: an unknown name (suggests the nearest), a wrong type, not one of the choices, out of range.
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    converted: dict[str, Any] = {}
    for name, value in values.items():
        if name not in fields:
            near = difflib.get_close_matches(str(name), fields, n=1, cutoff=0.0)
            raise OptionsError(f"unknown option {name!r}; did you mean {near[0]!r}? There are {', '.join(fields)}")
        converted[name] = _convert(name, value, fields[name].default)
    return cls(**converted)


def to_mapping(options: Any) -> dict[str, Any]:
    """Names and plain values of options, the inverse of `from_mapping`."""
    return {
        field.name: str(value) if isinstance(value := getattr(options, field.name), Enum) else value
        for field in dataclasses.fields(options)
    }


def _convert(name: str, value: Any, default: Any) -> Any:
    kind = type(default)
    if issubclass(kind, Enum):
        try:
            return kind(value)
        except ValueError:
            raise OptionsError(f"{name} must be one of {', '.join(kind)}, got {value!r}") from None
    if kind is tuple:
        # YAML, JSON and ROS parameters have lists and arrays, which are no tuples.
        if isinstance(value, list | tuple | array) and len(value) == len(default):
            return tuple(_convert(f"{name}[{index}]", each, default[index]) for index, each in enumerate(value))
        raise OptionsError(f"{name} must be {len(default)} numbers, got {value!r}")
    # In Python a bool is an int; `generations: yes` must not be 1.
    if isinstance(value, bool) == (kind is bool):
        if isinstance(value, kind):
            return value
        # YAML takes 1e3 for a text, 1.0e+3 for a number that is not whole.
        if kind in (int, float) and (found := _number(value)) is not None and (kind is float or found.is_integer()):
            return kind(found)
    raise OptionsError(f"{name} must be of type {kind.__name__}, got {value!r}")


def _number(value: Any) -> float | None:
    """A number that is one or is written as one, None if it is neither."""
    try:
        return float(value) if isinstance(value, int | float | str) else None
    except (ValueError, OverflowError):
        return None
