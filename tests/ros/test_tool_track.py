"""The tool's track: places between poses, the gripper by its commands, stretches in which nothing happens."""

import numpy as np
import pytest
from egophys_rehearsal.tool_track import ToolTrack
from scipy.spatial.transform import Rotation

SECOND = 1_000_000_000
DOWN = np.array([1.0, 0.0, 0.0, 0.0])
CLOUD = np.array([[0.01, 0.0, 0.0], [-0.01, 0.0, 0.02]])


def track_of(places, period_s=0.5):
    track = ToolTrack(closed_below=0.02)
    for index, place in enumerate(places):
        track.add_pose(round(index * period_s * SECOND), np.array(place), DOWN)
    return track


def test_points_lie_between_the_poses_before_and_after():
    track = track_of([(0.0, 0.0, 0.1), (0.2, 0.0, 0.1)])
    expected = Rotation.from_quat(DOWN).apply(CLOUD) + [0.05, 0.0, 0.1]
    np.testing.assert_allclose(track.points_at(SECOND // 8, CLOUD), expected, atol=1e-12)
    np.testing.assert_allclose(track.points_at(-SECOND, CLOUD).mean(axis=0), [0.0, 0.0, 0.09], atol=1e-12)
    np.testing.assert_allclose(track.points_at(9 * SECOND, CLOUD).mean(axis=0), [0.2, 0.0, 0.09], atol=1e-12)


def test_the_gripper_is_as_it_was_told_last():
    track = track_of([(0.0, 0.0, 0.1)])
    assert not track.is_closed(SECOND)
    track.add_opening(SECOND, 0.0)
    track.add_opening(3 * SECOND, 0.08)
    assert [track.is_closed(each * SECOND) for each in (0, 1, 2, 3)] == [False, True, True, False]
    track.forget_before(2 * SECOND)
    assert track.is_closed(2 * SECOND)
    track.open()
    assert not track.is_closed(2 * SECOND)


def test_a_pose_that_is_no_newer_is_dropped():
    track = track_of([(0.0, 0.0, 0.1), (0.2, 0.0, 0.1)])
    track.add_pose(SECOND // 2, np.array([9.0, 9.0, 9.0]), DOWN)
    assert track.newest_ns == SECOND // 2
    np.testing.assert_allclose(track.points_at(SECOND, CLOUD).mean(axis=0), [0.2, 0.0, 0.09], atol=1e-12)


def test_a_tool_that_turns_on_the_spot_is_not_still():
    track = ToolTrack(closed_below=0.02)
    for half_seconds, turn in enumerate((0.0, 0.0, 0.0, 0.1, 0.2)):
        rotation = (Rotation.from_rotvec([0.0, 0.0, turn]) * Rotation.from_quat(DOWN)).as_quat()
        track.add_pose(half_seconds * SECOND // 2, np.array([0.0, 0.0, 0.1]), rotation)
    assert track.still_until(0, since_ns=0) == SECOND


@pytest.mark.parametrize("forgotten", [False, True])
def test_nothing_happens_until_the_tool_moves_or_the_gripper_is_told(forgotten):
    still = [(0.0, 0.0, 0.1)] * 9
    track = track_of([*still, (0.01, 0.0, 0.1), (0.02, 0.0, 0.1)])
    if forgotten:
        track.forget_before(SECOND)
    assert track.still_until(2 * SECOND, since_ns=SECOND) == 4 * SECOND
    track.add_opening(3 * SECOND, 0.0)
    assert track.still_until(2 * SECOND, since_ns=SECOND) == 3 * SECOND
    # What happened since counts too.
    assert track.still_until(round(3.5 * SECOND), since_ns=SECOND) == round(3.5 * SECOND)
    assert track.still_until(round(4.8 * SECOND), since_ns=round(3.1 * SECOND)) == round(4.8 * SECOND)
