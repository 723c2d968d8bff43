"""A bag cut at any byte, or with any byte changed, gives a prefix of its records or one clear error."""

import os
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin, Writer

from egophys_core.errors import RecordingError
from egophys_core.recording import CutRecordingWarning, Record, jazzy_types, read_records


def read_damaged(path: Path) -> tuple[list[Record], list[str]]:
    """What is readable and what was said: warnings, or the error if nothing was."""
    read: list[Record] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            read.extend(read_records(path))
        except RecordingError as error:
            assert read == []
            return [], [str(error)]
    assert all(isinstance(warning.message, CutRecordingWarning) for warning in caught)
    return read, [str(warning.message) for warning in caught]


def assert_cuts_give_prefixes(path: Path, records: list[Record]) -> None:
    """Cut the file at `path` one byte more each time."""
    fewest = len(records)
    for size in reversed(range(path.stat().st_size)):
        os.truncate(path, size)
        read, said = read_damaged(path)
        assert read == records[: len(read)], f"cut at byte {size}"
        assert len(said) == 1, f"cut at byte {size}"
        assert str(path) in said[0]
        assert f"byte {size}" in said[0]
        assert len(read) <= fewest, f"more messages at byte {size} than beyond"
        fewest = len(read)
    assert fewest == 0


def change_each_byte(path: Path, offsets: Iterable[int], flip: int) -> Iterator[int]:
    """Change one byte of the file at a time; yields its offset while it is changed."""
    content = path.read_bytes()
    with path.open("r+b", buffering=0) as stream:
        for at in offsets:
            os.pwrite(stream.fileno(), bytes([content[at] ^ flip]), at)
            yield at
            os.pwrite(stream.fileno(), content[at : at + 1], at)


@pytest.mark.parametrize("compression", CompressionType)
def test_mcap_cut_at_every_byte(tmp_path, records, mcap_writer, compression):
    path = tmp_path / "bag.mcap"
    mcap_writer(path, records, compression=compression)
    assert_cuts_give_prefixes(path, records)


def test_mcap_without_chunks_cut_at_every_byte(tmp_path, records, mcap_writer):
    path = tmp_path / "bag.mcap"
    mcap_writer(path, records, use_chunking=False)
    assert_cuts_give_prefixes(path, records)


def test_cut_inside_an_uncompressed_chunk_gives_its_beginning(tmp_path, records, mcap_writer):
    path = tmp_path / "bag.mcap"
    mcap_writer(path, records, compression=CompressionType.NONE, per_chunk=len(records))
    content = path.read_bytes()
    path.write_bytes(content[: content.index(records[-1].cdr) + 10])
    read, _ = read_damaged(path)
    assert read == records[:-1]


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("flip", [0x01, 0x80, 0xFF])
def test_mcap_with_any_byte_changed(tmp_path, records, mcap_writer, compression, flip):
    path = tmp_path / "bag.mcap"
    mcap_writer(path, records, compression=compression)
    for at in change_each_byte(path, range(path.stat().st_size), flip):
        read, said = read_damaged(path)
        assert read == records[: len(read)], f"byte {at} changed"
        assert read == records or len(said) == 1, f"byte {at} changed"


def test_change_that_only_the_data_checksum_shows_is_said(tmp_path, records, mcap_writer):
    path = tmp_path / "bag.mcap"
    mcap_writer(path, records, use_chunking=False, enable_data_crcs=True)
    content = bytearray(path.read_bytes())
    content[content.index(records[5].cdr) + 50] ^= 1
    path.write_bytes(content)
    with pytest.warns(CutRecordingWarning, match="checksum of the data section"):
        list(read_records(path))


@pytest.fixture
def database(tmp_path, records):
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        connections = {
            topic: bag.add_connection(topic, "sensor_msgs/msg/PointCloud2", typestore=jazzy_types())
            for topic in ("/object/points", "/controller/points")
        }
        for record in records:
            bag.write(connections[record.topic], record.log_time_ns, record.cdr)
    return tmp_path / "bag" / "bag.db3"


def test_database_cut_anywhere_gives_one_error(database, records):
    assert read_damaged(database) == (records, [])
    for size in reversed(range(0, database.stat().st_size, 97)):
        os.truncate(database, size)
        read, said = read_damaged(database)
        assert (read, len(said)) == ([], 1)
        assert f"byte {size}" in said[0]
        assert str(database) in said[0]


def test_database_with_any_byte_changed_never_fails_otherwise(database):
    offsets = [*range(0, 4096, 3), *range(4096, database.stat().st_size, 61)]
    for _ in change_each_byte(database, offsets, 0xFF):
        read_damaged(database)  # SQLite has no checksums: only that nothing else is raised


def test_recorded_bag_cut_anywhere(shared_bags, tmp_path):
    bag = next(bag for bag in shared_bags if bag.parts[-3:-1] == ("open", "towel_none"))
    content, records = bag.read_bytes(), list(read_records(bag))
    path = tmp_path / "cut.mcap"

    @settings(max_examples=60, deadline=None)
    @given(st.integers(0, len(content) - 1))
    def check(size: int) -> None:
        path.write_bytes(content[:size])
        read, said = read_damaged(path)
        assert read == records[: len(read)]
        assert len(said) == 1

    check()
    path.write_bytes(content[: len(content) // 2])
    assert len(read_damaged(path)[0]) > len(records) // 3


def test_recorded_bag_with_any_byte_changed(shared_bags, tmp_path):
    bag = next(bag for bag in shared_bags if bag.parts[-3:-1] == ("open", "towel_none"))
    content, records = bag.read_bytes(), list(read_records(bag))
    path = tmp_path / "changed.mcap"
    path.write_bytes(content)

    @settings(max_examples=60, deadline=None)
    @given(st.integers(0, len(content) - 1), st.integers(1, 255))
    def check(at: int, flip: int) -> None:
        for _ in change_each_byte(path, [at], flip):
            read, said = read_damaged(path)
        assert read == records[: len(read)]
        assert read == records or len(said) == 1

    check()
