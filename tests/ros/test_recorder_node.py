"""recorder_node as an installed process: latched and streamed topics, replay from the log, kill, refusals."""

import json
import re
import resource
import warnings
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from egophys_msgs.msg import BuildJob, TwinInfo
from egophys_msgs.srv import RebuildTwin, RolloutTwin
from egophys_ros_common.conversions import plan_message, points_message
from egophys_ros_common.processes import wait_until
from egophys_ros_common.qos import latched
from lifecycle_msgs.msg import Transition
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String, UInt8MultiArray

from egophys_core.identification import episode_digest
from egophys_core.planning import grasp_from_points
from egophys_core.recording import CutRecordingWarning, decode_episode, find_lost, list_topics, read_records
from egophys_core.replay import ReplayOutcome, replay_log
from egophys_core.twin import decode_twin
from tests.ros.cloth import FRAMES, NAME, OPTIONS_JSON, SEED, lifting_plan
from tests.ros.jobs import wait_for_job

pytestmark = pytest.mark.ros

NODE = "/recorder_node"
CONFIGURATION = Path(__file__).resolve().parents[2] / "ros2_ws/src/egophys_twin/config"
TRAINING = "/twin_node/training"
OBJECT_POINTS, CONTROLLER_POINTS = f"{TRAINING}/object_points", f"{TRAINING}/controller_points"
TWIN_TOPICS = [
    "/twin_node/info",
    "/twin_node/model",
    "/twin_node/job",
    f"{TRAINING}/build",
    OBJECT_POINTS,
    CONTROLLER_POINTS,
    "/twin_node/predicted/plan",
    "/twin_node/predicted/points",
]
TRAINING_COUNTS = dict.fromkeys((OBJECT_POINTS, CONTROLLER_POINTS), FRAMES)


@pytest.fixture
def record(start_node, client):
    """`record(folder, topics)` starts a recorder and waits until it is active."""

    def start(folder, topics, **parameters):
        values = {"autostart": "true", "output_folder": folder, "topics": json.dumps(topics), **parameters}
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        node = start_node("egophys_twin", "recorder_node", "--ros-args", *words)
        client.wait_for_state(NODE, "active")
        return node

    return start


@pytest.fixture
def talk(client):
    """`talk(kind, topic, qos)` gives a publisher that ends with the test."""
    made = []

    def start(kind, topic, qos):
        made.append(client.node.create_publisher(kind, topic, qos))
        return made[-1]

    yield start
    for publisher in made:
        client.node.destroy_publisher(publisher)


def wait_for_counts(client, counts, recorder=NODE):
    """Wait until the recorder says that it wrote this many messages of these topics, or more."""

    def reached(status):
        written = {each.key: each.value for each in status.values}
        return all(written.get(topic, "").isdigit() and int(written[topic]) >= n for topic, n in counts.items())

    return client.message(DiagnosticStatus, f"{recorder}/status", reached, latched())


def build(client, bag, output, options=OPTIONS_JSON, node="/twin_node"):
    """Have the twin node build the small cloth's twin."""
    request = RebuildTwin.Request(episode_paths=[str(bag)], output_path=str(output), options_json=options, seed=SEED)
    assert client.call(RebuildTwin, f"{node}/rebuild", request).accepted
    wait_for_job(client, BuildJob.SUCCEEDED, node=node)


def messages(folder, topic, kind):
    return [deserialize_message(record.cdr, kind) for record in read_records(folder, [topic])]


def test_streams_and_state_are_recorded_whoever_starts_first(record, talk, client, tmp_path):
    folder = tmp_path / "log"
    early = talk(String, "/early", latched())
    early.publish(String(data="said before the recorder was there"))
    record(folder, ["/early", "late", "/stream", "/never"])
    late = talk(String, "/late", latched())
    late.publish(String(data="said before the recorder saw the topic"))
    stream = talk(PointCloud2, "/stream", qos_profile_sensor_data)
    wait_until(lambda: stream.get_subscription_count() == 1, 10, "the recorder's subscription")
    for index in range(20):
        stream.publish(points_message(np.full((1, 3), index, np.float32), ids=np.array([index])))
    status = wait_for_counts(client, {"/early": 1, "/late": 1, "/stream": 20})
    assert {each.key: each.value for each in status.values}["/never"] == "no publisher yet"
    assert client.change_state(NODE, Transition.TRANSITION_DEACTIVATE)

    assert {each.name: (each.type, each.messages) for each in list_topics(folder)} == {
        "/early": ("std_msgs/msg/String", 1),
        "/late": ("std_msgs/msg/String", 1),
        "/stream": ("sensor_msgs/msg/PointCloud2", 20),
    }
    assert messages(folder, "/early", String)[0].data == "said before the recorder was there"
    assert [each.width for each in messages(folder, "/stream", PointCloud2)] == [1] * 20
    received = [each.log_time_ns for each in read_records(folder, ["/stream"])]
    assert received == sorted(received)
    assert abs(received[0] - client.node.get_clock().now().nanoseconds) < 60e9
    metadata = (folder / "metadata.yaml").read_text()
    assert "durability: transient_local" in metadata
    assert "reliability: best_effort" in metadata
    # A log is not written over.
    assert not client.change_state(NODE, Transition.TRANSITION_ACTIVATE)
    assert client.state_of(NODE) == "inactive"


def test_a_log_of_a_build_and_a_prediction_replays(start_twin_node, record, client, bag, twin, tmp_path):
    folder = tmp_path / "log"
    recorder = record(folder, TWIN_TOPICS)
    start_twin_node()
    # Replay goes by the times of receipt; what is said before anyone listens is received in any order. The
    # build takes a few seconds, as real ones do, so that the recorder has found the topics by its end.
    wait_for_counts(client, {"/twin_node/model": 0, f"{TRAINING}/build": 0})
    build(client, bag, tmp_path / "a.twin", '{"generations": 40}')
    plan = lifting_plan(grasp_from_points(twin.grasp), 0.05)
    request = RolloutTwin.Request(plans=[plan_message(plan)])
    assert client.call(RolloutTwin, "/twin_node/rollout", request).success
    wait_for_counts(client, dict.fromkeys(TWIN_TOPICS, 1) | TRAINING_COUNTS)
    assert recorder.interrupt() == 0

    outcomes = {each.step: (each.outcome, each.detail) for each in replay_log(folder).steps}
    assert outcomes["build"][0] == ReplayOutcome.SAME, outcomes["build"]
    assert outcomes["prediction"][0] == ReplayOutcome.SAME, outcomes["prediction"]


def test_a_graph_in_a_namespace_logs_all_of_its_build_and_nothing_of_another_graph(
    start_node, start_twin_node, talk, client, bag, twin, tmp_path
):
    folder = tmp_path / "log"

    def start_in_lab(executable, config, *parameters):
        words = ("-r", "__ns:=/lab", "--params-file", str(CONFIGURATION / config), "-p", "autostart:=true", *parameters)
        node = start_node("egophys_twin", executable, "--ros-args", *words)
        client.wait_for_state(f"/lab/{executable}", "active")
        return node

    start_twin_node()
    start_in_lab("twin_node", "twin.yaml")
    # The recording was made without a namespace.
    build(client, bag, tmp_path / "a.twin", node="/lab/twin_node")
    elsewhere = client.call(RolloutTwin, "/twin_node/rollout", RolloutTwin.Request())
    assert "no twin is in use" in elsewhere.message
    observers = {name: talk(PointCloud2, name, latched()) for name in ("/object/points", "/lab/object/points")}
    for each in observers.values():
        each.publish(points_message(np.zeros((1, 3), np.float32), ids=np.array([0])))
    recorder = start_in_lab("recorder_node", "recorder.yaml", "-p", f"output_folder:={folder}")
    counts = dict.fromkeys([*TWIN_TOPICS[:-2], "/object/points"], 1) | TRAINING_COUNTS
    wait_for_counts(client, {f"/lab{topic}": n for topic, n in counts.items()} | {"/rosout": 1}, "/lab/recorder_node")
    assert recorder.interrupt() == 0

    recorded = {each.name for each in list_topics(folder) if each.messages}
    assert {name for name in recorded if not name.startswith("/lab/")} <= {"/rosout", "/diagnostics"}
    (info,) = messages(folder, "/lab/twin_node/info", TwinInfo)
    assert info.twin_id == twin.twin_id
    (model,) = messages(folder, "/lab/twin_node/model", UInt8MultiArray)
    assert decode_twin(bytes(model.data), name="model").twin_id == twin.twin_id
    training = decode_episode(
        read_records(folder),
        name=NAME,
        object_topic=f"/lab{OBJECT_POINTS}",
        controller_topic=f"/lab{CONTROLLER_POINTS}",
    )
    assert episode_digest(training) == twin.provenance.episodes[0]["sha256"]


def test_the_log_of_a_killed_recorder_opens(record, talk, client, tmp_path):
    folder = tmp_path / "log"
    publisher = talk(String, "/words", 10)
    recorder = record(folder, ["/words"], flush_interval_s="0.1")
    wait_until(lambda: publisher.get_subscription_count() == 1, 10, "the recorder's subscription")
    for index in range(50):
        publisher.publish(String(data=str(index)))
    wait_for_counts(client, {"/words": 50})
    wait_until(lambda: "message_count: 50" in (folder / "metadata.yaml").read_text(), 5, "the flush")
    recorder.kill()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CutRecordingWarning)
        assert [each.data for each in messages(folder, "/words", String)] == [str(n) for n in range(50)]


def test_a_disk_that_refuses_is_an_error_told_once(start_node, talk, client, tmp_path):
    folder = tmp_path / "log"
    parameters = ("-p", "topics:=['/words']", "-p", "flush_interval_s:=0.1")
    recorder = start_node("egophys_twin", "recorder_node", "--ros-args", *parameters)
    client.wait_for_state(NODE, "unconfigured")
    assert not client.change_state(NODE, Transition.TRANSITION_CONFIGURE), "nowhere to record to"
    assert client.set_parameter(NODE, "output_folder", str(folder)).successful
    client.start(NODE)
    publisher = talk(String, "/words", latched())
    publisher.publish(String(data="fits"))
    assert wait_for_counts(client, {"/words": 1}).level == DiagnosticStatus.OK
    wait_until(lambda: "message_count: 1" in (folder / "metadata.yaml").read_text(), 20, "the flush")
    _, hard = resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (20_000, hard))
    for _ in range(3):
        publisher.publish(String(data=np.random.default_rng(0).bytes(100_000).hex()))

    def refused(status):
        return status.level == DiagnosticStatus.ERROR

    told = client.message(DiagnosticStatus, f"{NODE}/status", refused, latched())
    assert "recording stopped" in told.message
    assert "File too large; free space or rights?" in told.message
    assert recorder.output.count("recording stopped") == 1
    # A file that grows again is recorded from the beginning, elsewhere.
    assert client.change_state(NODE, Transition.TRANSITION_DEACTIVATE)
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (hard, hard))
    assert client.set_parameter(NODE, "output_folder", str(tmp_path / "again")).successful
    assert client.change_state(NODE, Transition.TRANSITION_ACTIVATE)
    client.message(DiagnosticStatus, f"{NODE}/status", lambda each: each.level == DiagnosticStatus.OK, latched())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CutRecordingWarning)
        assert messages(folder, "/words", String)[0].data == "fits"


def test_messages_that_a_stalled_recorder_misses_are_counted(record, talk, client, tmp_path):
    folder, sent = tmp_path / "log", 400
    publishers = [talk(String, "/sentences", 10) for _ in range(2)]
    recorder = record(folder, ["/sentences"])
    for each in publishers:
        wait_until(lambda each=each: each.get_subscription_count() == 1, 10, "the recorder's subscription")
    recorder.pause()
    for index in range(sent):
        for each in publishers:
            # Two megabytes in all: more than buffers of sockets and shared memory hold.
            each.publish(String(data=f"{index} of a sentence that nobody has ears for".ljust(2500)))
    recorder.resume()
    # One more of each tells that some are missing before it.
    for each in publishers:
        each.publish(String(data="last"))

    def all_told(status):
        """Whether what was written (`12, 788 lost`) and what was lost are all that was sent."""
        return sum(int(number) for number in re.findall(r"\d+", status.values[0].value)) == 2 * (sent + 1)

    status = client.message(DiagnosticStatus, f"{NODE}/status", all_told, latched())
    assert "lost" in status.values[0].value
    assert status.level == DiagnosticStatus.WARN
    assert "messages were lost before they could be written" in status.message
    assert recorder.interrupt() == 0
    (lost,) = find_lost(folder, list_topics(folder))
    assert lost.topic == "/sentences"
    assert lost.messages == 2 * (sent + 1) - len(messages(folder, "/sentences", String))


@pytest.mark.parametrize(
    ("topics", "folder", "reason"),
    [([""], "log", "nothing to record"), (["no name"], "log", "must be a name"), (["/a"], ".", "exists already")],
)
def test_what_cannot_be_recorded_is_refused(start_node, tmp_path, topics, folder, reason):
    where = tmp_path / folder if folder else "''"
    parameters = ("-p", "autostart:=true", "-p", f"topics:={json.dumps(topics)}", "-p", f"output_folder:={where}")
    node = start_node("egophys_twin", "recorder_node", "--ros-args", *parameters)
    assert node.wait_for_end() == (2 if "must be" in reason else 1)
    assert reason in node.output
    assert "Traceback" not in node.output
