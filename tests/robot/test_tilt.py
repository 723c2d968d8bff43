"""Where a turn tilts the tool most."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from egophys_core.robot.tilt import steepest_between, tilt_of

DOWN = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])


@given(st.integers(0, 2**32 - 1), st.floats(0.01, np.pi))
def test_no_pose_on_a_turn_is_steeper(seed, angle):
    random = np.random.default_rng(seed)
    start, axis = Rotation.random(random_state=random), random.normal(size=3)
    turn = angle * axis / np.linalg.norm(axis)
    on_the_way = (start * Rotation.from_rotvec(np.linspace(0.0, 1.0, 401)[:, None] * turn)).as_matrix()
    tilts = [tilt_of(each) for each in on_the_way]
    found = steepest_between(start.as_matrix(), turn)
    if found is None:
        assert max(tilts) <= max(tilts[0], tilts[-1]) + 1e-6
    else:
        assert max(tilts) <= tilt_of(found) + 1e-7
        assert np.abs(on_the_way - found).max(axis=(1, 2)).min() <= angle / 400, "it is on the way"


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.0, 0.0]])
@pytest.mark.parametrize("start", [DOWN, Rotation.from_euler("zx", [0.3, 0.0]) * DOWN])
def test_a_tool_that_points_down_is_steepest_at_the_end_of_a_turn(start, turn):
    assert steepest_between(start.as_matrix(), np.array(turn)) is None


@given(st.floats(0.0, 3.0), st.floats(-3.0, 3.0))
def test_a_turn_about_the_vertical_tilts_nothing(tilt, angle):
    first, last = (Rotation.from_euler("zx", [each, tilt]) * DOWN for each in (0.0, angle))
    assert steepest_between(first.as_matrix(), (first.inv() * last).as_rotvec()) is None
