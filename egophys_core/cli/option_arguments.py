"""Options dataclasses on the command line: every field is an argument, a YAML file gives several at once."""

import argparse
import dataclasses
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import yaml

from egophys_core.errors import OptionsError
from egophys_core.options import from_mapping

T = TypeVar("T")


def add_option_arguments(parser: argparse.ArgumentParser, cls: type[Any]) -> None:
    """Add `--field-name` for every field of an options class, and `--options FILE`."""
    group = parser.add_argument_group("options", "each also a key of the YAML file given with --options")
    group.add_argument("--options", type=Path, metavar="YAML", help="file with options; arguments win over it")
    for field in dataclasses.fields(cls):
        low, high, doc = (field.metadata.get(key) for key in ("low", "high", "doc"))
        kind = type(field.default)
        shown = f"{doc} ({low:g} .. {high:g}; default {field.default})" if low is not None else None
        arguments: dict[str, Any] = {"type": kind, "help": shown or f"{doc} (default {field.default})"}
        if issubclass(kind, Enum):
            arguments |= {"type": str, "choices": [str(member) for member in kind]}
        elif kind is tuple:
            arguments |= {"type": float, "nargs": len(getattr(cls, field.name))}
        group.add_argument(f"--{field.name.replace('_', '-')}", default=argparse.SUPPRESS, **arguments)


def options_from(parsed: argparse.Namespace, cls: type[T]) -> T:
    """The options that a command line gives.

    Raises:
        OptionsError: the YAML file is absent or not a mapping, or an option is unknown or out of range.
    """
    values: dict[str, Any] = {}
    if parsed.options is not None:
        try:
            values = yaml.safe_load(parsed.options.read_text()) or {}
        except (OSError, yaml.YAMLError, UnicodeDecodeError) as error:
            raise OptionsError(f"cannot read options {parsed.options}: {error}") from error
        if not isinstance(values, dict):
            raise OptionsError(f"{parsed.options} must hold `name: value` lines, got {type(values).__name__}")
    names = {field.name for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    given = {name: value for name, value in vars(parsed).items() if name in names}
    return from_mapping(cls, {**values, **given})
