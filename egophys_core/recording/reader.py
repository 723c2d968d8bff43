"""Reading a bag, whatever it is stored as: one file, or a rosbag2 folder of several."""

import os
import re
import warnings
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

import yaml

from egophys_core.errors import RecordingError
from egophys_core.recording import mcap_file, sqlite_file
from egophys_core.recording.bag_metadata import INFORMATION_KEY, METADATA_NAME
from egophys_core.recording.records import (
    CutRecordingWarning,
    DamagedFileError,
    Record,
    TopicInfo,
    TopicTable,
)

_SUFFIXES = (".mcap", ".db3")

_StorageReader = Callable[[Path, TopicTable, Collection[str] | None], Iterator[Record]]


def read_records(path: Path | str, topics: Collection[str] | None = None) -> Iterator[Record]:
    """Yield the records of a bag in the order they were written, one at a time.

    A cut or damaged file gives the records before the damage, then a `CutRecordingWarning` that names the
    file and the byte; reading goes on with the next file of the folder.

    Args:
        path: an `.mcap` or `.db3` file, or a rosbag2 folder of them, with or without `metadata.yaml`.
        topics: topics to yield; None yields all.

    Raises:
        RecordingError: not a bag; cut before the first message; or, when all has been read, a topic of
            `topics` is not in the bag, naming those that are.
    """
    path = Path(path)
    table = TopicTable()
    yield from _read(path, table, topics)
    table.require(path, topics or ())


def list_topics(path: Path | str) -> list[TopicInfo]:
    """Read a bag through and return its topics with type and number of readable messages.

    Raises:
        RecordingError: not a bag, or cut before the first message.
    """
    table = TopicTable()
    for _ in _read(Path(path), table, frozenset()):
        pass
    return table.topics()


def _read(path: Path, table: TopicTable, wanted: Collection[str] | None) -> Iterator[Record]:
    unread: list[DamagedFileError] = []
    for file in storage_files(path):
        before = table.total
        try:
            yield from _storage_reader(file)(file, table, wanted)
        except DamagedFileError as damage:
            if table.total == before:
                unread.append(damage)
                continue
            what_was_read = f"the {table.total - before} messages before it were read"
            warnings.warn(CutRecordingWarning(damage.path, damage.offset, damage.reason, what_was_read), stacklevel=3)
        except OSError as error:
            raise RecordingError(f"{file}: cannot be read: {error.strerror or error}") from error
    if unread and table.total == 0:
        raise unread[0]
    for lost in unread:
        warnings.warn(
            CutRecordingWarning(lost.path, lost.offset, lost.reason, "the bag's other files were read"),
            stacklevel=3,
        )


def _storage_reader(path: Path) -> _StorageReader:
    """Choose by content, since files are renamed; a cut first line still tells what it was."""
    with path.open("rb") as stream:
        start = stream.read(len(sqlite_file.MAGIC))
    if not start:
        raise DamagedFileError(path, 0, "the file is empty")
    if mcap_file.MAGIC.startswith(start[: len(mcap_file.MAGIC)]):
        return mcap_file.read_mcap
    if sqlite_file.MAGIC.startswith(start):
        return sqlite_file.read_sqlite
    raise RecordingError(
        f"{path}: not a bag, it starts with {start[:8]!r}; give an .mcap or .db3 file or a rosbag2 folder "
        "(`egophys import` makes one from a film)"
    )


def storage_files(path: Path) -> list[Path]:
    """The files of a bag, in order.

    Raises:
        RecordingError: there are none, one is missing, or they are packed by rosbag2's own compression.
    """
    # Not `path.is_dir()`, which fails with a name that is too long.
    if os.path.isdir(path):
        files = _listed_files(path) or _found_files(path)
        if not files:
            raise RecordingError(f"{path}: not a bag, the folder holds no .mcap or .db3 file")
        return files
    if not os.path.isfile(path):
        raise RecordingError(f"{path}: no such file or folder")
    return [path]


def _listed_files(folder: Path) -> list[Path]:
    """Storage files in the order `metadata.yaml` gives; empty if it is absent or unreadable.

    Raises:
        RecordingError: a listed file is not there, or the bag is packed by rosbag2's own compression.
    """
    metadata = folder / METADATA_NAME
    if not metadata.is_file():
        return []
    try:
        information = yaml.safe_load(metadata.read_text("utf-8"))[INFORMATION_KEY]
        # Bags up to version 3 wrote the folder's name before the file's.
        files = [folder / Path(str(name)).name for name in information["relative_file_paths"]]
        mode = str(information.get("compression_mode") or "none").lower()
    except (OSError, yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError) as error:
        warnings.warn(
            CutRecordingWarning(
                metadata,
                metadata.stat().st_size,
                f"not readable ({type(error).__name__})",
                "the storage files in the folder are read in order of their numbers",
            ),
            stacklevel=5,
        )
        return []
    if mode != "none":
        raise RecordingError(
            f"{folder}: packed with rosbag2's {mode} compression, which is not read; unpack it with "
            "`ros2 bag convert`, or record with compressed chunks (--storage-preset-profile zstd_fast)"
        )
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise RecordingError(f"{folder}: {METADATA_NAME} lists {', '.join(missing)}, not in the folder; copy it again")
    return files


def _found_files(folder: Path) -> list[Path]:
    def by_number(path: Path) -> list[tuple[int, str]]:
        return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]

    return sorted((file for file in folder.iterdir() if file.suffix.lower() in _SUFFIXES), key=by_number)
