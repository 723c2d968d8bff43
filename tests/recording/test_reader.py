"""Every storage a bag comes in gives the same records; what is no bag gives one clear error."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from egophys_core.errors import RecordingError
from egophys_core.recording import (
    CutRecordingWarning,
    LogWriter,
    Record,
    TopicInfo,
    jazzy_types,
    list_topics,
    read_episode,
    read_records,
)

POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"


def write_with_rosbags(folder: Path, records: list[Record], plugin: StoragePlugin) -> None:
    with Writer(folder, version=9, storage_plugin=plugin) as bag:
        connections = {}
        for record in records:
            if record.topic not in connections:
                connections[record.topic] = bag.add_connection(record.topic, record.type, typestore=jazzy_types())
            bag.write(connections[record.topic], record.log_time_ns, record.cdr)


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("use_chunking", [True, False])
@pytest.mark.parametrize("enable_data_crcs", [True, False])
def test_mcap_of_every_kind_reads_back(tmp_path, records, mcap_writer, compression, use_chunking, enable_data_crcs):
    path = tmp_path / "bag.mcap"
    mcap_writer(path, records, compression=compression, use_chunking=use_chunking, enable_data_crcs=enable_data_crcs)
    assert list(read_records(path)) == records


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_folders_written_by_rosbags_read_back(tmp_path, records, plugin):
    write_with_rosbags(tmp_path / "bag", records, plugin)
    assert list(read_records(tmp_path / "bag")) == records
    (file,) = (file for file in (tmp_path / "bag").iterdir() if file.suffix != ".yaml")
    assert list(read_records(file)) == records


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_folder_without_metadata_reads_back(tmp_path, records, plugin):
    write_with_rosbags(tmp_path / "bag", records, plugin)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    assert list(read_records(tmp_path / "bag")) == records


def test_unreadable_metadata_is_said_and_the_files_are_found(tmp_path, records):
    write_with_rosbags(tmp_path / "bag", records, StoragePlugin.MCAP)
    (tmp_path / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_info")
    with pytest.warns(CutRecordingWarning, match=r"metadata\.yaml: not readable"):
        assert list(read_records(tmp_path / "bag")) == records


def test_split_bag_is_read_in_order_of_its_numbers(tmp_path, records, mcap_writer):
    for number, part in enumerate([records[:4], records[4:8], records[8:]]):
        mcap_writer(tmp_path / f"bag_{number + 9}.mcap", part)
    assert list(read_records(tmp_path)) == records


def test_split_bag_is_read_in_the_order_of_its_metadata(tmp_path, records, mcap_writer):
    mcap_writer(tmp_path / "late.mcap", records[8:])
    mcap_writer(tmp_path / "zearly.mcap", records[:8])
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths: [old_name/zearly.mcap, late.mcap]\n"
    )
    assert list(read_records(tmp_path)) == records


def test_cut_part_of_a_split_bag_does_not_hide_the_next(tmp_path, records, mcap_writer):
    mcap_writer(tmp_path / "bag_0.mcap", records[:6])
    mcap_writer(tmp_path / "bag_1.mcap", records[6:])
    whole = (tmp_path / "bag_0.mcap").read_bytes()
    (tmp_path / "bag_0.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.warns(CutRecordingWarning) as caught:
        read = list(read_records(tmp_path))
    assert caught[0].message.path.name == "bag_0.mcap"
    assert f"the {len(read) - 6} messages before it were read" in str(caught[0].message)
    assert read[-6:] == records[6:]


def test_unreadable_part_of_a_split_bag_is_said(tmp_path, records, mcap_writer):
    (tmp_path / "bag_0.mcap").write_bytes(b"\x89MCAP0")
    mcap_writer(tmp_path / "bag_1.mcap", records)
    (tmp_path / "bag_2.mcap").touch()
    with pytest.warns(CutRecordingWarning) as caught:
        assert list(read_records(tmp_path)) == records
    assert [(w.message.path.name, w.message.offset) for w in caught] == [("bag_0.mcap", 6), ("bag_2.mcap", 0)]


def test_topics_are_listed_with_type_and_count(tmp_path, records):
    with LogWriter(tmp_path / "bag") as log:
        log.add_topic("/object/points", POINTCLOUD2)
        log.add_topic("/empty", "std_msgs/msg/String")
        log.write("/object/points", records[0].cdr, 7)
    assert list_topics(tmp_path / "bag") == [
        TopicInfo(name="/object/points", type=POINTCLOUD2, messages=1),
        TopicInfo(name="/empty", type="std_msgs/msg/String", messages=0),
    ]


def test_missing_topic_names_the_topics_there_are_and_the_nearest(tmp_path, records, mcap_writer):
    mcap_writer(tmp_path / "bag.mcap", records)
    with pytest.raises(RecordingError) as error:
        list(read_records(tmp_path / "bag.mcap", ["/object/point"]))
    message = str(error.value)
    assert "no topic /object/point;" in message
    assert f"/object/points ({POINTCLOUD2}, 6 messages)" in message
    assert "/controller/points" in message
    assert "Did you mean /object/points?" in message


def test_wanted_topics_only(tmp_path, records, mcap_writer):
    mcap_writer(tmp_path / "bag.mcap", records)
    wanted = list(read_records(tmp_path / "bag.mcap", ["/object/points"]))
    assert wanted == [record for record in records if record.topic == "/object/points"]


def test_what_is_no_bag_is_refused_in_one_sentence(tmp_path):
    (tmp_path / "picture.mcap").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "folder").mkdir()
    for name, expected in [
        ("picture.mcap", r"not a bag, it starts with b'\\x89PNG"),
        ("empty.mcap", "the file is empty"),
        ("folder", r"holds no \.mcap or \.db3 file"),
        ("absent", "no such file or folder"),
    ]:
        with pytest.raises(RecordingError, match=expected):
            list(read_records(tmp_path / name))


def test_listed_file_that_is_gone_is_named(tmp_path, records):
    write_with_rosbags(tmp_path / "bag", records, StoragePlugin.MCAP)
    (tmp_path / "bag" / "bag.mcap").unlink()
    with pytest.raises(RecordingError, match=r"lists bag\.mcap, not in the folder"):
        list(read_records(tmp_path / "bag"))


def test_rosbag2_file_compression_is_refused_with_the_way_out(tmp_path, records):
    bag = Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    bag.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with bag:
        bag.add_connection("/object/points", POINTCLOUD2, typestore=jazzy_types())
    with pytest.raises(RecordingError, match="ros2 bag convert"):
        list(read_records(tmp_path / "bag"))


def test_database_of_something_else_is_refused(tmp_path):
    with sqlite3.connect(tmp_path / "other.db3") as database:
        database.execute("CREATE TABLE birds (name TEXT)")
    with pytest.raises(RecordingError, match=r"not a rosbag2 one; it has the tables \['birds'\]"):
        list(read_records(tmp_path / "other.db3"))


def test_database_whose_topics_are_not_named_by_texts(tmp_path, records):
    write_with_rosbags(tmp_path / "bag", records, StoragePlugin.SQLITE3)
    with sqlite3.connect(tmp_path / "bag" / "bag.db3") as database:
        database.execute("UPDATE topics SET name = CAST(name AS BLOB)")
    with pytest.raises(RecordingError, match="name and type of topic number 1 are no texts"):
        list_topics(tmp_path / "bag")


def test_database_with_messages_outside_of_it_is_refused(tmp_path, records):
    write_with_rosbags(tmp_path / "bag", records, StoragePlugin.SQLITE3)
    (tmp_path / "bag" / "bag.db3-wal").write_bytes(b"messages")
    with pytest.raises(RecordingError, match="was not closed"):
        list(read_records(tmp_path / "bag"))


def test_every_recorded_episode_reads(shared_bags):
    for bag in shared_bags:
        episode = read_episode(bag)
        assert episode.points.shape == (episode.frames, len(episode.point_ids), 3), bag
        assert episode.controllers.shape[::2] == (episode.frames, 3), bag
        assert episode.visible.any(axis=0).all(), bag
        assert (np.diff(episode.times) > 0.0).all(), bag
