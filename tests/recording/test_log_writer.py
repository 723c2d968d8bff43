"""Logs are rosbag2 MCAP folders that other readers open, also after the recorder was killed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader

import egophys_core
from egophys_core.errors import RecordingError
from egophys_core.recording import (
    LATCHED_QOS,
    SENSOR_QOS,
    CutRecordingWarning,
    LogWriter,
    TopicQos,
    decode_points,
    definition_from_folder,
    read_records,
    standard_definition,
)

POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"

# What ROS 2 Jazzy's recorder writes, field by field and in this order.
INFORMATION = [
    *("version", "storage_identifier", "duration", "starting_time", "message_count"),
    *("topics_with_message_count", "compression_format", "compression_mode", "relative_file_paths", "files"),
    *("custom_data", "ros_distro"),
]
TOPIC = ["name", "type", "serialization_format", "offered_qos_profiles", "type_description_hash"]
QOS = {
    "history": "keep_last",
    "depth": 1,
    "reliability": "reliable",
    "durability": "transient_local",
    "deadline": {"sec": 9223372036, "nsec": 854775807},
    "lifespan": {"sec": 9223372036, "nsec": 854775807},
    "liveliness": "automatic",
    "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
    "avoid_ros_namespace_conventions": False,
}


@pytest.fixture
def log(tmp_path, records):
    with LogWriter(tmp_path / "log") as writer:
        writer.add_topic("/object/points", POINTCLOUD2, SENSOR_QOS)
        writer.add_topic("/controller/points", POINTCLOUD2, LATCHED_QOS)
        for record in records:
            writer.write(record.topic, record.cdr, record.log_time_ns)
    return tmp_path / "log"


def test_closed_log_opens_with_rosbags(log, records):
    with Reader(log) as bag:
        assert [(c.topic, t, bytes(data)) for c, t, data in bag.messages()] == [
            (record.topic, record.log_time_ns, record.cdr) for record in records
        ]
        assert bag.message_count == len(records)
        assert bag.start_time == records[0].log_time_ns
        assert bag.end_time == records[-1].log_time_ns + 1
        (latched,) = bag.topics["/controller/points"].connections[0].ext.offered_qos_profiles
        assert latched.durability is QosDurability.TRANSIENT_LOCAL
        (sensor,) = bag.topics["/object/points"].connections[0].ext.offered_qos_profiles
        assert (sensor.reliability, sensor.depth) == (QosReliability.BEST_EFFORT, 5)


def test_messages_decode_by_the_definitions_in_the_log_alone(log, records):
    (log / "metadata.yaml").unlink()
    with AnyReader([next(log.glob("*.mcap"))]) as bag:
        for record, (connection, _, data) in zip(records, bag.messages(), strict=True):
            message = bag.deserialize(data, connection.msgtype)
            assert message.header.frame_id == "world"
            expected = decode_points(record.cdr, source="test").xyz
            np.testing.assert_array_equal(message.data.view(np.float32).reshape(-1, 5)[:, :3], expected)


def test_mcap_is_of_profile_ros2_with_qos_and_type_hash(log):
    with next(log.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        embedded = [record.metadata["serialized_metadata"] for record in reader.iter_metadata()]
    channel = next(c for c in summary.channels.values() if c.topic == "/controller/points")
    assert channel.message_encoding == "cdr"
    assert yaml.safe_load(channel.metadata["offered_qos_profiles"]) == [QOS]
    assert channel.metadata["topic_type_hash"] == standard_definition(POINTCLOUD2).type_hash
    assert summary.schemas[channel.schema_id].encoding == "ros2msg"
    assert [yaml.safe_load(text)["version"] for text in embedded] == [9, 9]
    assert (
        yaml.safe_load(embedded[-1])
        == yaml.safe_load((log / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    )


def test_metadata_is_that_of_jazzy(log, records):
    text = (log / "metadata.yaml").read_text()
    (information,) = yaml.safe_load(text).values()
    assert "&" not in text
    assert list(information) == INFORMATION
    assert information["version"] == 9
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == ["log_0.mcap"]
    assert information["custom_data"] is None
    assert information["ros_distro"] == "jazzy"
    span = {
        "starting_time": {"nanoseconds_since_epoch": records[0].log_time_ns},
        "duration": {"nanoseconds": records[-1].log_time_ns - records[0].log_time_ns},
        "message_count": len(records),
    }
    assert information["files"] == [{"path": "log_0.mcap", **span}]
    assert {key: information[key] for key in span} == span
    topic = information["topics_with_message_count"][1]
    assert topic["message_count"] == len(records) / 2
    assert list(topic["topic_metadata"]) == TOPIC
    assert topic["topic_metadata"]["offered_qos_profiles"] == [QOS]


def test_empty_log_is_a_bag(tmp_path):
    LogWriter(tmp_path / "log").close()
    assert list(read_records(tmp_path / "log")) == []
    with Reader(tmp_path / "log") as bag:
        assert bag.message_count == 0


def test_existing_folder_is_not_overwritten(tmp_path):
    (tmp_path / "log").mkdir()
    with pytest.raises(RecordingError, match="exists already and is not overwritten"):
        LogWriter(tmp_path / "log")
    assert list((tmp_path / "log").iterdir()) == []


def test_folder_that_cannot_be_made_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="cannot write the log"):
        LogWriter(tmp_path / "file" / "log")


def test_log_of_a_failed_block_is_closed(tmp_path, records):
    def record_and_fail() -> None:
        with LogWriter(tmp_path / "log") as writer:
            writer.add_topic("/object/points", POINTCLOUD2)
            writer.write("/object/points", records[0].cdr, 5)
            raise InterruptedError

    with pytest.raises(InterruptedError):
        record_and_fail()
    assert [record.cdr for record in read_records(tmp_path / "log")] == [records[0].cdr]


def test_wrong_use_is_refused(tmp_path):
    with LogWriter(tmp_path / "log") as writer:
        writer.add_topic("/a", "std_msgs/msg/String")
        with pytest.raises(RecordingError, match="declared before"):
            writer.add_topic("/a", "std_msgs/msg/Int32")
        with pytest.raises(RecordingError, match=r"/b is not declared.* Declared: /a"):
            writer.write("/b", bytes(8), 0)
        with pytest.raises(RecordingError, match="at least 4 bytes"):
            writer.write("/a", b"", 0)
        with pytest.raises(RecordingError, match="log time"):
            writer.write("/a", bytes(8), -1)
        with pytest.raises(RecordingError, match="definition given is of std_msgs"):
            writer.add_topic("/c", "std_msgs/msg/Int32", None, standard_definition("std_msgs/msg/String"))
    with pytest.raises(RecordingError, match="is closed"):
        writer.write("/a", bytes(8), 0)
    writer.close()
    with pytest.raises(RecordingError, match="depth must be at least 1"):
        TopicQos(depth=0)


@pytest.mark.parametrize(
    "options", [{"flush_interval_s": 0.0}, {"chunk_bytes": 1}, {"flush_interval_s": 0.0, "chunk_bytes": 1}]
)
def test_what_is_flushed_is_in_the_file_and_in_the_metadata(tmp_path, records, options):
    writer = LogWriter(tmp_path / "log", **options)
    writer.add_topic("/object/points", POINTCLOUD2)
    for count, record in enumerate(records, start=1):
        writer.write("/object/points", record.cdr, record.log_time_ns)
        with pytest.warns(CutRecordingWarning, match="without a footer"):
            assert len(list(read_records(tmp_path / "log"))) == count
        (information,) = yaml.safe_load((tmp_path / "log" / "metadata.yaml").read_text()).values()
        assert information["message_count"] == count
    writer.close()


KILLED_RECORDER = """
import sys
from egophys_core.recording import LogWriter

log = LogWriter(sys.argv[1], flush_interval_s=3600)
log.add_topic("/count", "std_msgs/msg/Int32")
for number in range(100_000):
    if number == 1000:
        log.flush()
    if number == 1500:
        print("recording", flush=True)
        sys.stdin.readline()
    log.write("/count", b"\\0\\1\\0\\0" + number.to_bytes(4, "little"), number)
"""


def test_killed_recorder_leaves_what_was_flushed(tmp_path):
    environment = os.environ | {"PYTHONPATH": str(Path(egophys_core.__file__).parents[1])}
    with subprocess.Popen(
        [sys.executable, "-c", KILLED_RECORDER, str(tmp_path / "log")],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as recorder:
        assert recorder.stdout.readline() == b"recording\n"
        recorder.send_signal(signal.SIGKILL)
        assert recorder.wait(timeout=30) == -signal.SIGKILL
    with pytest.warns(CutRecordingWarning, match="recorder killed"):
        read = list(read_records(tmp_path / "log", ["/count"]))
    assert [int.from_bytes(record.cdr[4:], "little") for record in read] == list(range(1000))
    (information,) = yaml.safe_load((tmp_path / "log" / "metadata.yaml").read_text()).values()
    assert information["message_count"] == 1000
    assert information["topics_with_message_count"][0]["topic_metadata"]["name"] == "/count"


def test_recorder_killed_at_any_moment_leaves_a_readable_bag(tmp_path):
    script = KILLED_RECORDER.replace("flush_interval_s=3600", "chunk_bytes=400").replace("sys.stdin", "#")
    environment = os.environ | {"PYTHONPATH": str(Path(egophys_core.__file__).parents[1])}
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path / "log")], env=environment, stdout=subprocess.PIPE
    ) as recorder:
        recorder.stdout.readline()
        recorder.send_signal(signal.SIGKILL)
        recorder.wait(timeout=30)
    with pytest.warns(CutRecordingWarning):
        read = list(read_records(tmp_path / "log"))
    numbers = [int.from_bytes(record.cdr[4:], "little") for record in read]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= 1500 - 100  # a chunk of 400 bytes holds 50 of these messages
    assert yaml.safe_load((tmp_path / "log" / "metadata.yaml").read_text())


def test_hash_of_a_standard_type_is_that_of_ros():
    # As `ros2 topic info --verbose` prints it for std_msgs/msg/String on Jazzy.
    expected = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert standard_definition("std_msgs/msg/String").type_hash == expected


def test_unknown_type_suggests_the_nearest():
    with pytest.raises(RecordingError, match=r"did you mean sensor_msgs/msg/PointCloud2\?"):
        standard_definition("sensor_msg/msg/PointCloud2")


def test_definition_from_a_folder_holds_all_it_contains(tmp_path, records):
    folder = tmp_path / "share" / "bird_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Flock.msg").write_text(
        "# A flock.\nuint8 SMALL=1\nstd_msgs/Header header\nBird[] birds # all of them\nstring name 'crows'\n"
    )
    (folder / "Bird.msg").write_text("geometry_msgs/Point[<=3] path\nfloat64[2] wings\n")
    definition = definition_from_folder("bird_msgs/msg/Flock", folder)
    assert "uint8 SMALL=1\nstd_msgs/Header header\nbird_msgs/Bird[] birds\n" in definition.text
    contained = ["std_msgs/Header", "builtin_interfaces/Time", "bird_msgs/Bird", "geometry_msgs/Point"]
    for name in contained:
        assert f"\n{'=' * 80}\nMSG: {name}\n" in definition.text
    assert definition.type_hash.startswith("RIHS01_")

    with LogWriter(tmp_path / "log") as log:
        log.add_topic("/flock", "bird_msgs/msg/Flock", definition=definition)
        log.add_topic("/object/points", POINTCLOUD2)
        log.write("/object/points", records[0].cdr, 1)
    with AnyReader([tmp_path / "log"]) as bag:
        assert "bird_msgs/msg/Bird" in bag.typestore.fielddefs
    with pytest.raises(RecordingError, match="is the package built and sourced"):
        definition_from_folder("bird_msgs/msg/Nest", folder)
    (folder / "Broken.msg").write_text("float64 ???\n")
    with pytest.raises(RecordingError, match=r"Broken\.msg: not a readable message definition"):
        definition_from_folder("bird_msgs/msg/Flock", folder)
