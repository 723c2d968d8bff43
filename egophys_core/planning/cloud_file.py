"""Points from files that hold a shape: .npy, .ply, .pcd, .xyz, .csv; metres, world."""

from pathlib import Path

import numpy as np

from egophys_core.errors import PlanningError

PCD_KEYS = ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA")
HEADER_LINES = 20
"""Lines within which the header of a .pcd file ends, comments included."""


def read_cloud(path: Path, what: str) -> np.ndarray:
    """[P, 3] float64, as the file has them: neither their unit nor that they are finite is checked.

    Args:
        path: the file.
        what: it is read as, for messages: target, start.

    Raises:
        PlanningError: absent, cut, of another kind, or not P rows of three numbers.
    """
    try:
        points = np.asarray(READERS[path.suffix.lower()](path))
    except OSError as error:
        raise PlanningError(f"cannot read {what} {path}: {error.strerror or error}") from error
    except Exception as error:
        # The readers raise whatever a broken file does to their arithmetic.
        raise PlanningError(f"cannot read {what} {path}: not a readable {path.suffix} file: {error}") from error
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "iuf":
        raise PlanningError(f"{what} {path} must be [P, 3] points in metres, got {points.dtype} {points.shape}")
    return points.astype(np.float64)


def _npy(path: Path) -> np.ndarray:
    return np.asarray(np.load(path, allow_pickle=False))


def _ply(path: Path) -> np.ndarray:
    # Takes a second to import, and only who reads a .ply needs it.
    import trimesh

    with path.open("rb") as stream:
        return np.asarray(trimesh.load(stream, file_type="ply", process=False).vertices)


def _table(path: Path) -> np.ndarray:
    """Lines of numbers apart by commas, semicolons or blanks, the first three of them x y z; a first line may name."""
    lines = [line.replace(",", " ").replace(";", " ").split() for line in path.read_text("utf-8").splitlines()]
    rows = [line for line in lines if line and not line[0].startswith("#")]
    if rows and not _is_number(rows[0][0]):
        names = [name.strip("\"' ").lower() for name in rows.pop(0)]
        columns = [names.index(name) for name in "xyz"] if {*"xyz"} <= {*names} else []
        if not columns:
            raise ValueError(f"its first line names no x, y and z: {' '.join(names)}")
        return np.array([[float(row[column]) for column in columns] for row in rows]).reshape(-1, 3)
    return np.array([[float(each) for each in row[:3]] for row in rows]).reshape(-1, 3)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _pcd(path: Path) -> np.ndarray:
    """The Point Cloud Library's own format, version 0.7, ascii or binary."""
    content = path.read_bytes()
    lines = content.split(b"\n", HEADER_LINES)
    header: dict[str, list[str]] = {}
    begin = 0
    for line in lines[:HEADER_LINES]:
        begin += len(line) + 1
        words = line.decode("ascii").split()
        if words:
            header[words[0]] = words[1:]
        if "DATA" in header:
            break
    missing = [key for key in PCD_KEYS if key not in header]
    if missing:
        raise ValueError(f"its header lacks {', '.join(missing)}")
    names, data = header["FIELDS"], header["DATA"][0]
    counts = [int(each) for each in header.get("COUNT", ["1"] * len(names))]
    formats = [
        f"({count},)<{kind.lower()}{size}"
        for kind, size, count in zip(header["TYPE"], header["SIZE"], counts, strict=True)
    ]
    points = int(header["POINTS"][0])
    if data == "ascii":
        rows = np.array([line.split() for line in content[begin:].decode("ascii").splitlines()], float)
        columns = np.cumsum([0, *counts])[[names.index(name) for name in "xyz"]]
        return np.asarray(rows[:points, columns])
    if data != "binary":
        raise ValueError(f"its data are {data}; write it as ascii or binary (pcl_convert_pcd_ascii_binary)")
    table = np.frombuffer(content, np.dtype(list(zip(names, formats, strict=True))), points, begin)
    return np.concatenate([table[name] for name in "xyz"], axis=1)


READERS = {".npy": _npy, ".ply": _ply, ".pcd": _pcd, ".xyz": _table, ".csv": _table}
"""By extension."""
