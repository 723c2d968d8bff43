"""Executed plans in a log become episodes: the object as it was seen, the hands as the tool moved."""

from dataclasses import replace

import numpy as np
import pytest
from egophys_ros_common.conversions import points_message, time_message, world_header
from egophys_twin.executions import EXECUTED_TOPIC, execution_episodes, has_executions
from egophys_twin.recorded_topics import source_in, topic_in
from egophys_twin.recordings import observed_episodes
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import Path
from rclpy.serialization import serialize_message

from egophys_core.episode_source import EpisodeSource
from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.recording import (
    LATCHED_QOS,
    OBJECT_TOPIC,
    SENSOR_QOS,
    LogWriter,
    list_topics,
    standard_definition,
    write_episode,
)
from tests.ros.cloth import cloth_episode

BEGIN_NS = 1_700_000_000_000_000_000
GRASP = np.array([[0.1, 0.0, 0.02], [0.11, 0.01, 0.03], [0.12, -0.01, 0.01]])
MIDDLE = GRASP.mean(axis=0)
DOWN = (1.0, 0.0, 0.0, 0.0)
QUARTER_TURN = np.sqrt(0.5)


def executed(begin_s, places, turns=None, period_s=0.02):
    """The path of a tool that was at [S, 3] `places`, and the time its first pose was measured."""
    poses = []
    for index, place in enumerate(np.asarray(places, float).tolist()):
        stamp = time_message(BEGIN_NS + round((begin_s + index * period_s) * 1e9))
        x, y, z, w = turns[index] if turns is not None else DOWN
        pose = Pose(position=Point(**dict(zip("xyz", place, strict=True))), orientation=Quaternion(x=x, y=y, z=z, w=w))
        poses.append(PoseStamped(header=world_header(stamp), pose=pose))
    return Path(header=poses[0].header, poses=poses)


def write_log(folder, paths, seconds):
    """A log of 12 points that rise by 1 cm/s, seen at 30 Hz, and of executed paths."""
    with LogWriter(folder) as log:
        log.add_topic(
            OBJECT_TOPIC, "sensor_msgs/msg/PointCloud2", SENSOR_QOS, standard_definition("sensor_msgs/msg/PointCloud2")
        )
        log.add_topic(EXECUTED_TOPIC, "nav_msgs/msg/Path", LATCHED_QOS, standard_definition("nav_msgs/msg/Path"))
        for frame in range(round(seconds * 30)):
            stamp = BEGIN_NS + round(frame / 30 * 1e9)
            points = np.column_stack([np.arange(12) / 100, np.zeros(12), np.full(12, frame / 3000)])
            log.write(
                OBJECT_TOPIC,
                serialize_message(points_message(points, ids=np.arange(12), stamp=time_message(stamp))),
                stamp,
            )
        for path in paths:
            log.write(EXECUTED_TOPIC, serialize_message(path), BEGIN_NS)
    return folder


def line(first, last, count):
    return np.linspace(first, last, count)


def test_each_executed_plan_is_an_episode_of_its_own_time(tmp_path):
    paths = [
        executed(1.0, line(MIDDLE, MIDDLE + [0.0, 0.0, 0.1], 101)),
        executed(5.0, line(MIDDLE, MIDDLE + [0.2, 0.0, 0.0], 51)),
    ]
    log = write_log(tmp_path / "log", paths, seconds=8.0)
    assert has_executions(log)
    up, across = execution_episodes(log, object_topic=OBJECT_TOPIC, grasp=GRASP, ground_height=0.01)
    assert [up.name, across.name] == ["log_execution_1", "log_execution_2"]
    assert up.times[-1] == pytest.approx(2.0, abs=0.05)
    assert across.times[-1] == pytest.approx(1.0, abs=0.05)
    assert up.ground_height == 0.01
    np.testing.assert_allclose(up.points[:, 0, 2], 0.01 + up.times * 0.01, atol=1e-3)
    # The points move as the tool: from where the hand took hold, at the speed of the path.
    np.testing.assert_allclose(up.controllers[0], GRASP, atol=2e-3)
    np.testing.assert_allclose(up.controllers[-1] - up.controllers[0], np.tile([0, 0, 0.1], (3, 1)), atol=3e-3)
    speed = np.diff(across.controllers[:, 0, 0]) / np.diff(across.times)
    np.testing.assert_allclose(speed, 0.2, rtol=1e-3)


def test_the_points_turn_with_the_tool(tmp_path):
    # A quarter turn about the world's vertical, after half a turn about x: points down, fingers turned.
    turned = (QUARTER_TURN, QUARTER_TURN, 0.0, 0.0)
    path = executed(0.0, np.tile(MIDDLE, (51, 1)), turns=[DOWN] * 25 + [turned] * 26)
    log = write_log(tmp_path / "log", [path], seconds=2.0)
    (episode,) = execution_episodes(log, object_topic=OBJECT_TOPIC, grasp=GRASP)
    x, y, z = (GRASP - MIDDLE).T
    np.testing.assert_allclose(episode.controllers[-1], MIDDLE + np.column_stack([-y, x, z]), atol=1e-6)


def test_a_plan_executed_before_the_log_began_is_left_out(tmp_path):
    paths = [executed(-9.0, line(MIDDLE, MIDDLE + 0.1, 101)), executed(1.0, line(MIDDLE, MIDDLE + 0.1, 101))]
    log = write_log(tmp_path / "log", paths, seconds=4.0)
    (episode,) = execution_episodes(log, object_topic=OBJECT_TOPIC, grasp=GRASP)
    assert episode.name == "log_execution_2"
    empty = write_log(tmp_path / "empty", paths[:1], seconds=4.0)
    with pytest.raises(EpisodeError, match="no points on /object/points while one of 1 plans was executed"):
        execution_episodes(empty, object_topic=OBJECT_TOPIC, grasp=GRASP)


def test_logs_and_bags_are_read_alike_with_names_that_tell_them_apart(tmp_path, bag):
    logs = [
        write_log(tmp_path / folder / "log", [executed(0.5, line(MIDDLE, MIDDLE + 0.1, 51))], seconds=2.0)
        for folder in ("one", "two")
    ]
    shares = []
    episodes = observed_episodes(
        [*logs, bag],
        EpisodeSource(),
        executed_topic=EXECUTED_TOPIC,
        grasp=GRASP,
        ground_height=0.0,
        progress=lambda stage, share: shares.append(share),
    )
    assert [each.name for each in episodes] == ["log_execution_1_1", "log_execution_1_2", "cloth"]
    assert not has_executions(bag)
    assert shares == sorted(shares)


def test_a_name_in_a_namespace_is_the_recorded_one_or_the_same_at_the_root(tmp_path, bag):
    log = write_log(tmp_path / "log", [executed(0.5, line(MIDDLE, MIDDLE + 0.1, 51))], seconds=2.0)
    in_lab = EpisodeSource(object_topic="/lab/object/points", controller_topic="/lab/controller/points")
    episodes = observed_episodes(
        [log, bag],
        in_lab,
        executed_topic=f"/lab{EXECUTED_TOPIC}",
        namespace="/lab",
        grasp=GRASP,
        ground_height=0.0,
        progress=lambda stage, share: None,
    )
    assert [each.name for each in episodes] == ["log_execution_1", "cloth"]
    lab_bag = tmp_path / "lab"
    write_episode(cloth_episode(), lab_bag, object_topic=in_lab.object_topic)
    assert source_in(list_topics(lab_bag), in_lab, "/lab") == replace(in_lab, controller_topic="/controller/points")
    assert topic_in(list_topics(bag), "/lab/object/points", "/elsewhere") == "/lab/object/points"


def test_what_is_no_log_is_refused(tmp_path):
    (tmp_path / "no.mcap").write_bytes(b"no bag")
    with pytest.raises(RecordingError, match="not a bag"):
        has_executions(tmp_path / "no.mcap")
