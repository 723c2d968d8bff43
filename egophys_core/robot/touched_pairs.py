"""The file of pairs that the arm touched: points in the world, or corners of printed tags, and where the tip was."""

import csv
import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from egophys_core.errors import RobotError

TagCorner = Callable[[int, int], np.ndarray]
"""World place [3], metres, of a corner (0 to 3) of the tag with an id; raises EgophysError if there is none."""

_AXES = ("x", "y", "z")
_UNITS = {"": 1.0, "_m": 1.0, "_mm": 1e-3}


@dataclass(frozen=True, kw_only=True)
class TouchedPairs:
    """Points known in both frames, in the order of their file."""

    names: tuple[str, ...]
    """`line 2`, `tag 3 corner 0`."""
    world: np.ndarray
    """[N, 3] float64, metres."""
    base: np.ndarray
    """[N, 3] float64, metres, robot base frame: place of the tip that touched."""


def read_touched_pairs(path: Path, tag_corner: TagCorner) -> TouchedPairs:
    """Read a CSV file with a header line.

    Columns `world_x,world_y,world_z,base_x,base_y,base_z` or `tag,corner,base_x,base_y,base_z`, in any order: metres,
    or millimetres where a name ends in `_mm`. Empty lines and those that begin with # are passed over.

    Args:
        path: the file.
        tag_corner: where the corners of the printed tags are.

    Raises:
        RobotError: not readable, columns missing or unknown, or a value that is no number; names the line.
        EgophysError: no such tag.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"cannot read {path}: {error}") from error
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not numbered:
        raise RobotError(
            f"{path} is empty; its first line names the columns: world_x,world_y,world_z,base_x,base_y,base_z"
        )
    try:
        header, *rows = [[cell.strip() for cell in row] for row in csv.reader(line for _, line in numbered)]
    except csv.Error as error:
        raise RobotError(f"cannot read {path}: {error}") from error
    base = _columns(path, header, "base")
    by_tag = "tag" in header
    world = [("tag", 1.0), ("corner", 1.0)] if by_tag else _columns(path, header, "world")
    _require_known(path, header, [name for name, _ in (*world, *base)])
    names, places = [], []
    for (number, _), row in zip(numbered[1:], rows, strict=True):
        where = f"{path} line {number}"
        if len(row) != len(header):
            raise RobotError(f"{where} has {len(row)} values for {len(header)} columns")
        cells = dict(zip(header, row, strict=True))
        touched = [_number(where, name, cells[name]) * unit for name, unit in base]
        known = [_number(where, name, cells[name]) * unit for name, unit in world]
        if by_tag:
            tag, corner = (_whole(where, name, value) for (name, _), value in zip(world, known, strict=True))
            names.append(f"tag {tag} corner {corner}")
            places.append([*tag_corner(tag, corner), *touched])
        else:
            names.append(f"line {number}")
            places.append([*known, *touched])
    table = np.array(places, np.float64).reshape(-1, 6)
    return TouchedPairs(names=tuple(names), world=table[:, :3], base=table[:, 3:])


def _columns(path: Path, header: Sequence[str], frame: str) -> list[tuple[str, float]]:
    """Names of a frame's three columns, each with what its numbers are multiplied by to be metres."""
    found = []
    for axis in _AXES:
        named = [(f"{frame}_{axis}{end}", unit) for end, unit in _UNITS.items() if f"{frame}_{axis}{end}" in header]
        if len(named) != 1:
            there = ", ".join(header)
            raise RobotError(
                f"{path} needs one column {frame}_{axis} (metres) or {frame}_{axis}_mm; its first line names {there}"
            )
        found += named
    return found


def _require_known(path: Path, header: Sequence[str], known: Sequence[str]) -> None:
    for name in header:
        if name not in known or header.count(name) > 1:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"used are {', '.join(known)}"
            raise RobotError(f"{path} has a column {name!r} that is unknown or there twice; {hint}")


def _number(where: str, name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise RobotError(f"{where}: {name} must be a number, got {text!r}") from error


def _whole(where: str, name: str, value: float) -> int:
    if not value.is_integer():
        raise RobotError(f"{where}: {name} must be a whole number, got {value:g}")
    return int(value)
