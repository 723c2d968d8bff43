"""Looking at a recording before the work: the topics of a whole one, the reason for any other."""

import os
import sqlite3
import warnings

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin, Writer

from egophys_core.errors import RecordingError
from egophys_core.recording import LogWriter, inspect_recording, jazzy_types, list_topics

POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"


@pytest.fixture
def log(tmp_path, records):
    """A log in two chunks."""
    with LogWriter(tmp_path / "log") as writer:
        for topic in ("/object/points", "/controller/points"):
            writer.add_topic(topic, POINTCLOUD2)
        for index, record in enumerate(records):
            writer.write(record.topic, record.cdr, record.log_time_ns)
            if index == 5:
                writer.flush()
    return tmp_path / "log"


def refused(path) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(RecordingError) as error:
            inspect_recording(path)
    return str(error.value)


@pytest.mark.parametrize("use_chunking", [True, False])
def test_whole_recordings_give_their_topics(log, tmp_path, records, mcap_writer, use_chunking):
    mcap_writer(tmp_path / "a.mcap", records, use_chunking=use_chunking)
    for path in (log, tmp_path / "a.mcap"):
        assert inspect_recording(path) == list_topics(path)
        assert [topic.messages for topic in inspect_recording(path)] == [6, 6]


def test_parts_of_a_split_bag_are_counted_together(tmp_path, records, mcap_writer):
    mcap_writer(tmp_path / "bag_0.mcap", records[:4])
    mcap_writer(tmp_path / "bag_1.mcap", records[4:])
    assert [topic.messages for topic in inspect_recording(tmp_path)] == [6, 6]


def test_file_cut_anywhere_is_refused_or_as_a_killed_recorder_leaves_it(tmp_path, records, mcap_writer):
    path = tmp_path / "bag.mcap"
    mcap_writer(path, records)
    left = []
    for size in reversed(range(path.stat().st_size)):
        os.truncate(path, size)
        try:
            left.append(inspect_recording(path))
        except RecordingError as error:
            reason = str(error)
            assert reason.startswith(str(path))
            assert f"byte {size}" in reason
    # Three chunks and two indexes behind each end somewhere; the next record is not begun before its head of 9 bytes.
    assert len(left) == 9 * (3 + 3 * 2)
    assert {topic.messages for topics in left for topic in topics} == {2, 4, 6}


def test_log_cut_between_two_chunks_is_refused_by_what_its_metadata_counts(log):
    (file,) = log.glob("*.mcap")
    with file.open("rb") as stream:
        second = make_reader(stream).get_summary().chunk_indexes[1].chunk_start_offset
    os.truncate(file, second)
    assert "3 messages lost on /object/points: 6 were written, 3 can be read" in refused(log)
    # Alone it is as a killed recorder leaves one.
    assert [topic.messages for topic in inspect_recording(file)] == [3, 3]


def test_index_that_does_not_fit_the_file_is_not_believed(tmp_path, records, mcap_writer):
    path = tmp_path / "bag.mcap"
    mcap_writer(path, records)
    whole = path.read_bytes()
    path.write_bytes(whole[:400] + whole[500:])
    assert "damaged chunk" in refused(path)


def test_what_is_no_recording_is_refused_with_the_reason(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "text.mcap").write_text("a,b,c\n")
    with sqlite3.connect(tmp_path / "other.db3") as database:
        database.execute("CREATE TABLE people (name TEXT)")
    for name, reason in (
        ("folder", r"holds no .mcap or .db3 file"),
        ("empty.mcap", "the file is empty"),
        ("text.mcap", "not a bag, it starts with b'a,b,c"),
        ("other.db3", "a database, but not a rosbag2 one"),
        ("absent.mcap", "no such file or folder"),
    ):
        assert reason in refused(tmp_path / name)


def test_database_gives_its_topics_and_a_cut_one_the_reason(tmp_path, records):
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        made = bag.add_connection("/object/points", POINTCLOUD2, typestore=jazzy_types())
        bag.add_connection("/controller/points", POINTCLOUD2, typestore=jazzy_types())
        bag.write(made, 1, records[0].cdr)
    assert [topic.messages for topic in inspect_recording(tmp_path / "bag")] == [1, 0]
    os.truncate(tmp_path / "bag" / "bag.db3", 3000)
    assert "the database is cut" in refused(tmp_path / "bag")


def test_recorded_bag_cut_in_half_is_refused_with_the_place(shared_bags, tmp_path):
    for bag in shared_bags[::30]:
        content = bag.read_bytes()
        path = tmp_path / bag.name
        path.write_bytes(content)
        assert inspect_recording(path) == list_topics(path)
        path.write_bytes(content[: len(content) // 2])
        assert f"cut inside a record (byte {len(content) // 2})" in refused(path)
