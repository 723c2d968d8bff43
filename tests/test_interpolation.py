"""Records read at other times: straight lines, shortest turns, and held ends."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.interpolation import PosesOverTime, values_at

TIMES = np.array([0.0, 1.0, 3.0])
RECORD = np.array([[[0.0, 1.0]], [[2.0, 1.0]], [[6.0, -3.0]]])


def test_values_lie_on_straight_lines_and_are_held_at_the_ends():
    found = values_at(TIMES, RECORD, np.array([-1.0, 0.5, 1.0, 2.0, 9.0]))
    assert found.shape == (5, 1, 2)
    np.testing.assert_allclose(found[:, 0], [[0.0, 1.0], [1.0, 1.0], [2.0, 1.0], [4.0, -1.0], [6.0, -3.0]])


def test_one_time_has_no_axis_of_its_own():
    np.testing.assert_allclose(values_at(TIMES, RECORD, 2.0), [[4.0, -1.0]])


def test_poses_turn_the_shortest_way_at_a_steady_rate():
    turns = Rotation.from_rotvec([[0.0, 0.0, angle] for angle in (0.0, 0.4, 0.4)])
    places = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 2.0, 0]])
    positions, rotations = PosesOverTime(TIMES, places, turns).at(np.array([-1.0, 0.25, 2.0, 5.0]))
    np.testing.assert_allclose(positions, [[0, 0, 0], [0.25, 0, 0], [1, 1, 0], [1, 2, 0]])
    np.testing.assert_allclose(rotations.as_rotvec()[:, 2], [0.0, 0.1, 0.4, 0.4], atol=1e-12)


@pytest.mark.parametrize("time", [-1.0, 0.0, 4.0])
def test_a_single_pose_holds_always(time):
    poses = PosesOverTime(np.array([0.0]), np.array([[1.0, 2.0, 3.0]]), Rotation.from_rotvec([[0.0, 0.0, 0.3]]))
    position, rotation = poses.at(time)
    np.testing.assert_allclose(position, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(rotation.apply([1.0, 0.0, 0.0]), [np.cos(0.3), np.sin(0.3), 0.0])
    positions, rotations = poses.at(np.array([time, 7.0]))
    assert positions.shape == (2, 3)
    assert len(rotations) == 2
