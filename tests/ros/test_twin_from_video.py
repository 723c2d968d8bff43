"""twin_node and recorder_node as installed processes: a twin from a video, with progress, cancel and replay."""

import json
from pathlib import Path

import pytest
from action_msgs.msg import GoalStatus
from egophys_msgs.action import BuildTwin
from egophys_msgs.msg import BuildJob
from egophys_msgs.srv import RebuildTwin
from egophys_ros_common.qos import latched
from std_msgs.msg import String

from egophys_core.perception.report_message import REPORT_TOPIC, STRING, report_message
from egophys_core.recording import SENSOR_QOS, LogWriter, list_topics, read_records
from egophys_core.replay import ReplayOutcome, replay_log
from tests.ros.cloth import SEED

pytestmark = pytest.mark.ros

NODE = "/twin_node"
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
VIDEO, POINTS = EXAMPLES / "towel_lift_video.mcap", EXAMPLES / "towel_lift_video_points.mcap"
IMAGES, INFO = "/ego/image_raw/compressed", "/ego/camera_info"
HELD_FRAMES = 75
"""Of the video; the hand takes hold in the first 40."""


@pytest.fixture
def cut(tmp_path):
    """`cut(name, frames, topics)`: a bag with the first frames of the video and its measured points."""

    def write(name, frames, topics):
        with LogWriter(tmp_path / name) as log:
            for bag in (VIDEO, POINTS):
                for topic in list_topics(bag):
                    if topic.name in topics:
                        log.add_topic(topic.name, topic.type, SENSOR_QOS)
                        for record in list(read_records(bag, [topic.name]))[:frames]:
                            log.write(record.topic, record.cdr, record.log_time_ns)
        return tmp_path / name

    return write


def goal(bag, output, **options):
    return BuildTwin.Goal(
        episode_paths=[str(bag)], output_path=str(output), options_json=json.dumps(options), seed=SEED
    )


def test_perception_tells_how_far_it_is_and_can_be_canceled(start_twin_node, client, cut, tmp_path):
    start_twin_node()
    bag = cut("both", HELD_FRAMES, (IMAGES, INFO, "/object/points", "/controller/points"))
    output = tmp_path / "a.twin"
    told = []
    handle = client.send_goal(
        BuildTwin,
        f"{NODE}/build",
        goal(bag, output, source="video"),
        lambda each: told.append((each.stage, each.progress)),
    )
    assert handle.accepted
    client.message(
        BuildJob, f"{NODE}/job", lambda job: job.stage.startswith("perceive") and job.progress > 0.01, latched()
    )
    client.cancel(handle)
    ended = client.result(handle)
    assert ended.status == GoalStatus.STATUS_CANCELED
    assert "stopped at perceive" in ended.result.message
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert {stage.split(":")[0] for stage, _ in told} >= {"perceive"}
    assert not output.exists()


def test_a_video_that_cannot_be_perceived_fails_with_the_reason(start_twin_node, client, cut, tmp_path):
    start_twin_node()
    for name, topics, options, reason in (
        ("no_info", (IMAGES,), {}, INFO),
        ("no_board", (IMAGES, INFO), {"board.first_id": 200}, "egophys board"),
    ):
        handle = client.send_goal(
            BuildTwin, f"{NODE}/build", goal(cut(name, 6, topics), tmp_path / "a.twin", **options)
        )
        assert handle.accepted
        ended = client.result(handle)
        assert ended.status == GoalStatus.STATUS_ABORTED
        assert reason in ended.result.message


def test_points_of_a_poor_video_are_refused_with_the_verdict(start_twin_node, client, tmp_path):
    start_twin_node()
    bag = tmp_path / "poor"
    remark = {"name": "rest", "level": "bad", "text": "it never rests", "advice": "do not touch it"}
    with LogWriter(bag) as log:
        log.add_topic(REPORT_TOPIC, STRING)
        log.write(REPORT_TOPIC, report_message({"remarks": [remark]}), 0)
        for topic in list_topics(POINTS):
            log.add_topic(topic.name, topic.type, SENSOR_QOS)
        for record in list(read_records(POINTS))[:9]:
            log.write(record.topic, record.cdr, record.log_time_ns)
    # So short that it cannot be fitted where it is forced.
    for options, reason in (({}, "it never rests: do not touch it"), ({"force": True}, "no hand moves the object")):
        handle = client.send_goal(BuildTwin, f"{NODE}/build", goal(bag, tmp_path / "a.twin", **options))
        assert handle.accepted
        ended = client.result(handle)
        assert ended.status == GoalStatus.STATUS_ABORTED
        assert reason in ended.result.message
        assert ("parameter `force`" in ended.result.message) == (not options)


def test_options_of_perception_are_checked_before_the_build(start_twin_node, client, tmp_path):
    start_twin_node()
    for options, reason in (
        ({"source": "film"}, "source must be one of auto, points, video"),
        ({"force": "yes"}, "force must be of type bool"),
        ({"perception.querys": 300}, "did you mean 'queries'"),
        ({"perception.queries": 3}, "queries must be in 100 .. 20000, got 3"),
        ({"board.rows": 1}, "at least 2 columns, 2 rows"),
        ({"perception.object_box": [1, 2]}, "object_box must be 4 numbers"),
    ):
        request = RebuildTwin.Request(
            episode_paths=[str(VIDEO)], output_path=str(tmp_path / "a.twin"), options_json=json.dumps(options)
        )
        answer = client.call(RebuildTwin, f"{NODE}/rebuild", request)
        assert not answer.accepted
        assert reason in answer.message


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_log_of_a_build_from_video_replays(start_node, start_twin_node, client, cut, tmp_path):
    folder = tmp_path / "log"
    names = ("model", "job", "training/build", "training/object_points", "training/controller_points")
    topics = json.dumps([f"{NODE}/{name}" for name in names])
    parameters = ("-p", "autostart:=true", "-p", f"topics:={topics}", "-p", f"output_folder:={folder}")
    recorder = start_node("egophys_twin", "recorder_node", "--ros-args", *parameters)
    client.wait_for_state("/recorder_node", "active")
    start_twin_node()
    bag = cut("video", HELD_FRAMES, (IMAGES, INFO))
    options = {"generations": 2, "population": 4, "dense_steps": 1, "perception.object_points": 300}
    handle = client.send_goal(BuildTwin, f"{NODE}/build", goal(bag, tmp_path / "a.twin", **options))
    assert handle.accepted
    ended = client.result(handle, timeout=400)
    assert ended.result.success, ended.result.message
    build = json.loads(client.message(String, f"{NODE}/training/build", qos=latched()).data)
    (episode,) = build["episodes"]
    assert episode["perception"]["report"]["kind"] == "sheet"
    assert episode["perception"]["report"]["posed"] == HELD_FRAMES
    assert episode["perception"]["options"]["object_points"] == 300
    assert recorder.interrupt() == 0
    outcomes = {each.step: (each.outcome, each.detail) for each in replay_log(folder).steps}
    assert outcomes["build"][0] == ReplayOutcome.SAME, outcomes["build"]
