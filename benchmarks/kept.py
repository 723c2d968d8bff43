"""Result files that fill up: a row is kept as soon as it is measured, and a run goes on where the last one stopped."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.side_by_side import side_by_side
from egophys_core.files import write_json

Item = TypeVar("Item")


def kept_in(path: Path, empty: dict[str, Any]) -> dict[str, Any]:
    """What an earlier run left in a file, or what a first one begins with."""
    return json.loads(path.read_text()) if path.exists() else empty


def fill(
    path: Path,
    kept: dict[str, Any],
    rows: dict[str, Any],
    measure: Callable[[Item], Any],
    items: Mapping[str, Item],
) -> None:
    """Measure the items that have no row, and write the file after each.

    Args:
        kept: all that the file holds.
        rows: the part of it that fills up, by name.
        measure: what a new process can import.
        items: what there is to measure, by name.
    """
    names = {item: name for name, item in items.items() if name not in rows}
    for item, row in side_by_side(measure, names):
        rows[names[item]] = row
        write_json(path, kept)
