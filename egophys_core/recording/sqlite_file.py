"""Reading one SQLite3 storage file of a rosbag2 folder."""

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path

from egophys_core.errors import RecordingError
from egophys_core.recording.records import DamagedFileError, Record, TopicTable

MAGIC = b"SQLite format 3\0"
_HEADER_BYTES = 100


def read_sqlite(path: Path, topics: TopicTable, wanted: Collection[str] | None) -> Iterator[Record]:
    """Yield the records of one SQLite3 storage file in the order they were written.

    A cut database is refused as a whole: SQLite fills what is missing of a cut page with zeros, which would
    pass for measured points.

    Args:
        path: the file; it starts with the SQLite magic.
        topics: filled with the topics and their counts, wanted or not.
        wanted: topics to yield; None yields all.

    Raises:
        DamagedFileError: the file is cut or damaged.
        RecordingError: not a rosbag2 database, not closed, or a wanted topic is not CDR.
    """
    _check_complete(path)
    uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    names: dict[int, tuple[str, str, str]] = {}
    try:
        with closing(sqlite3.connect(uri, uri=True)) as database:
            tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if not {"topics", "messages"} <= tables:
                raise RecordingError(f"{path}: a database, but not a rosbag2 one; it has the tables {sorted(tables)}")
            for number, name, type_name, encoding in database.execute(
                "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
            ):
                if not (isinstance(name, str) and isinstance(type_name, str)):
                    raise DamagedFileError(
                        path, None, f"the database is damaged: name and type of topic number {number!r} are no texts"
                    )
                names[number] = (name, type_name, encoding)
                topics.declare(name, type_name)
            for number, log_time, data in database.execute(
                "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
            ):
                if number not in names or not isinstance(log_time, int) or not isinstance(data, bytes):
                    raise DamagedFileError(path, None, f"the database is damaged: a message of topic number {number!r}")
                name, type_name, encoding = names[number]
                topics.count(name)
                if wanted is None or name in wanted:
                    if encoding != "cdr":
                        raise RecordingError(f"{path}: {name} is encoded as {encoding!r}; only cdr is read")
                    yield Record(topic=name, type=type_name, log_time_ns=log_time, cdr=data)
    except (sqlite3.Error, UnicodeDecodeError, OverflowError) as error:
        raise DamagedFileError(path, None, f"the database is damaged: {error}") from error


def _check_complete(path: Path) -> None:
    """Compare the file's size with the one in its header (https://sqlite.org/fileformat2.html, 1.3)."""
    log = path.with_name(f"{path.name}-wal")
    if log.exists() and log.stat().st_size > 0:
        raise RecordingError(
            f"{path}: was not closed, {log.name} holds messages that are not in it; "
            f"run: sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )
    size = path.stat().st_size
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
    if size < _HEADER_BYTES:
        raise DamagedFileError(path, size, "cut inside the database header")
    page_size = int.from_bytes(header[16:18], "big")
    page_size = 65536 if page_size == 1 else page_size
    expected = page_size * int.from_bytes(header[28:32], "big")
    if size < expected:
        raise DamagedFileError(path, size, f"the database is cut: {expected} bytes expected")
