"""Small YAML files with a fixed set of keys: a misspelt key is an error, never silently ignored."""

import difflib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from egophys_core.errors import RobotError


def load_mapping(path: Path) -> dict[str, Any]:
    """The top-level mapping of a YAML file.

    Raises:
        RobotError: the file is missing, unreadable, no YAML, or no mapping.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise RobotError(f"cannot read {path}: {error}") from error
    if not isinstance(content, dict):
        raise RobotError(f"{path} must hold 'key: value' lines, got {type(content).__name__}")
    return content


def check_keys(mapping: Any, where: str, *, required: Collection[str], optional: Collection[str] = ()) -> None:
    """Refuse a mapping with unknown or missing keys; the message suggests the nearest known name."""
    if not isinstance(mapping, dict):
        raise RobotError(f"{where} must be a mapping with {sorted(required)}, got {mapping!r}")
    known = [*required, *optional]
    for key in mapping:
        if key not in known:
            near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.4)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
            raise RobotError(f"{where} has an unknown key {key!r}; {hint}")
    missing = [key for key in required if key not in mapping]
    if missing:
        raise RobotError(f"{where} lacks {', '.join(missing)}")


def number_array(value: Any, where: str, count: int) -> np.ndarray:
    """A list of `count` finite numbers as float64 [count]."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise RobotError(f"{where} must be {count} numbers, got {value!r}") from error
    if array.shape != (count,) or not np.isfinite(array).all():
        raise RobotError(f"{where} must be {count} finite numbers, got {value!r}")
    return array
