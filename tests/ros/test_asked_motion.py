"""A motion that is asked for: moved to where the object lies, ended by letting go, and made an episode of."""

import numpy as np
import pytest
from egophys_ros_common.conversions import time_message, world_header
from egophys_twin.asked_motion import placement, plan_that_lets_go, points_at_rest, rigid_placement
from egophys_twin.executions import execution_episode, measured_path
from egophys_twin.seen_object import ObjectRecording
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import Path
from scipy.spatial.transform import Rotation

from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.experiments.hand_path import PathWriter
from egophys_core.planning import grasp_from_points
from egophys_core.recording import OBJECT_TOPIC, encode_points
from egophys_core.waypoint_plan import OPEN

BEGIN_NS = 1_700_000_000_000_000_000
YAW, SHIFT = np.deg2rad(25.0), np.array([0.08, -0.05, 0.0])
TURN = Rotation.from_rotvec([0.0, 0.0, YAW]).as_matrix()


def nanoseconds(seconds):
    return BEGIN_NS + round(seconds * 1e9)


def seen(recording, seconds, points):
    """Have a recording take points at a time."""
    points = np.asarray(points, np.float32)
    cdr = encode_points(
        stamp_ns=nanoseconds(seconds),
        frame_id="world",
        xyz=points,
        ids=np.arange(len(points), dtype=np.uint32),
        confidence=np.ones(len(points), np.float32),
    )
    recording.take(cdr)


def lifted(place):
    writer = PathWriter(place)
    writer.move([0.0, 0.0, 0.1], peak_speed=0.2)
    return writer.path()


def test_a_path_goes_with_the_object(twin):
    rest = twin.model.graph.positions.astype(np.float64)
    points = rest @ TURN.T + SHIFT + np.random.default_rng(0).normal(0.0, 5e-4, rest.shape)
    pose = placement(twin, points)
    place = rest[np.argmax(rest[:, 0] + rest[:, 1])]
    path = lifted(place)
    moved = pose.of(path)
    np.testing.assert_allclose(moved.positions, path.positions @ TURN.T + SHIFT, atol=4e-3)
    np.testing.assert_array_equal(moved.times, path.times)


def test_an_object_that_lies_otherwise_is_not_taken(twin):
    rest = twin.model.graph.positions.astype(np.float64)
    folded = np.column_stack([-np.abs(rest[:, 0]), rest[:, 1:]])
    with pytest.raises(
        EpisodeError, match=f"does not lie as twin {twin.twin_id} does at rest.*; lay it down as it lay"
    ):
        placement(twin, folded)
    assert rigid_placement(rest, folded) is None
    with pytest.raises(EpisodeError, match="3 points of it are seen"):
        placement(twin, rest[:3])


def test_an_object_is_at_rest_that_has_not_moved_for_a_second():
    places = np.random.default_rng(0).uniform(-0.1, 0.1, (30, 3))
    recording = ObjectRecording(OBJECT_TOPIC)
    with pytest.raises(EpisodeError, match="not seen"):
        points_at_rest(recording.frames(0))
    for frame in range(20):
        seen(recording, frame / 10, places + [0.0, 0.0, max(0, 5 - frame) / 50])
    with pytest.raises(EpisodeError, match="the object moves"):
        points_at_rest([each for each in recording.frames(0) if each.stamp_ns <= nanoseconds(1.0)])
    with pytest.raises(EpisodeError, match="less than 1 s"):
        points_at_rest(recording.frames(nanoseconds(1.5)))
    np.testing.assert_allclose(points_at_rest(recording.frames(0)), places, atol=1e-6)


def test_after_the_motion_the_gripper_opens_and_rises_no_higher_than_it_may():
    path = lifted(np.array([0.1, 0.0, 0.02]))
    plan = plan_that_lets_go(path, highest=0.45)
    count = len(path.times)
    assert plan.twin_id == ""
    np.testing.assert_allclose(plan.positions[:count], path.positions)
    np.testing.assert_allclose(plan.times[count:] - path.times[-1], [0.5, 1.5])
    assert plan.gripper_opening[count - 1 :].tolist() == [0.0, OPEN, OPEN]
    np.testing.assert_allclose(plan.positions[count:] - path.positions[-1], [[0, 0, 0], [0, 0, 0.08]], atol=1e-12)
    assert plan_that_lets_go(path, highest=0.15).positions[-1, 2] == pytest.approx(0.15)
    assert plan_that_lets_go(path, highest=0.1).positions[-1, 2] == pytest.approx(0.12)


def test_clouds_and_the_tool_path_are_an_episode_of_the_motion_alone():
    grasp = np.array([[0.1, 0.0, 0.02], [0.11, 0.01, 0.03], [0.12, -0.01, 0.01]])
    middle = grasp.mean(axis=0)
    recording = ObjectRecording(OBJECT_TOPIC)
    for frame in range(-30, 150):
        seen(
            recording, frame / 30, np.column_stack([np.arange(12) / 100, np.zeros(12), np.full(12, 0.01 + frame / 3e4)])
        )
    poses = []
    for index in range(201):
        x, y, z = (middle + [0.0, 0.0, 0.002 * index]).tolist()
        pose = Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=1.0, y=0.0, z=0.0, w=0.0))
        poses.append(PoseStamped(header=world_header(time_message(nanoseconds(index / 50))), pose=pose))
    path = measured_path(Path(poses=poses), source="motion 1").until(3.0)
    frames = path.frames(recording.records())
    episode = execution_episode(
        path, frames, grasp_from_points(grasp), name="motion", object_topic=OBJECT_TOPIC, ground_height=0.01
    )
    assert (episode.name, episode.ground_height, episode.frames) == ("motion", 0.01, len(frames))
    assert episode.times[-1] == pytest.approx(3.0, abs=0.04)
    np.testing.assert_allclose(episode.points[:, 0, 2], 0.01 + episode.times / 1e3, atol=1e-5)
    np.testing.assert_allclose(
        episode.controllers[:, :, 2] - grasp[:, 2], 0.1 * episode.times[:, None] + np.zeros(3), atol=1e-3
    )
    assert not measured_path(Path(), source="none").frames(recording.records())


def test_points_of_another_frame_are_refused():
    recording = ObjectRecording(OBJECT_TOPIC)
    points = np.zeros((2, 3), np.float32)
    cdr = encode_points(
        stamp_ns=1, frame_id="camera", xyz=points, ids=np.arange(2, dtype=np.uint32), confidence=np.ones(2, np.float32)
    )
    recording.take(cdr)
    with pytest.raises(RecordingError, match="in frame 'camera', needed is 'world'"):
        recording.newest_ns()
