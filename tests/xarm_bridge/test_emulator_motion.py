"""Ways of moving that the SDK offers, through the real SDK: where the arm goes, and what it is held to."""

import struct

import numpy as np
import pytest

from tests.xarm_bridge.emulator_process import TOOL_DOWN, reported_pose, wait_until

AXES = ("x", "y", "z", "roll", "pitch", "yaw")


def enter_mode(api, mode):
    assert [api.set_mode(mode), api.set_state(0)] == [0, 0]
    wait_until(lambda: api.mode == mode, 5, f"mode {mode} in the reports")


def watch(api, read, until):
    """What `read()` gives while a move runs."""
    seen = []
    while not until():
        seen.append(read())
    return np.array(seen)


def test_single_joints_and_single_axes_end_where_they_should(ready):
    """The SDK fills in what is not given; nothing of its last report, up to 0.2 s old, may get into that."""
    rng = np.random.default_rng(0)
    joints = np.array(ready.get_servo_angle()[1][:6])
    for joint in rng.integers(6, size=8):
        joints[joint] += rng.uniform(-0.1, 0.1)
        assert ready.set_servo_angle(servo_id=int(joint) + 1, angle=joints[joint], wait=True) == 0
        np.testing.assert_allclose(ready.get_servo_angle()[1][:6], joints, atol=2e-6)
    pose = np.array([320.0, 10.0, 300.0, 3.0, 0.1, 0.2])
    assert ready.set_position(*pose, wait=True) == 0
    for axis in rng.integers(6, size=8):
        pose[axis] += rng.uniform(-20, 20) if axis < 3 else rng.uniform(-0.05, 0.05)
        assert ready.set_position(**{AXES[axis]: pose[axis]}, wait=True) == 0
        np.testing.assert_allclose(reported_pose(ready), pose, atol=1e-3)


def test_clients_are_told_when_motions_start_and_end(ready):
    frames = []
    ready.register_feedback_callback(frames.append)
    assert ready.set_feedback_type(3) == 0
    for y in (10, 20, 400):
        ready.set_position(300, y, 300, *TOOL_DOWN, speed=200 if y < 100 else 10, feedback_key=str(y))
    wait_until(lambda: len(frames) >= 5, 10, "the start of the third line")
    ready.emergency_stop()
    wait_until(lambda: len(frames) >= 6, 10, "the end of the third line")
    ready.set_feedback_type(0)
    ready.release_feedback_callback(frames.append)
    starts, ends = (1, 0), (2, 0)
    assert [(frame[8], frame[12]) for frame in frames] == [starts, ends, starts, ends, starts, (2, 2)]
    assert {frame[9] for frame in frames} == {21}
    first, second, third = (struct.unpack(">H", frame[:2])[0] for frame in frames[::2])
    assert first < second < third


@pytest.mark.parametrize(("percent", "end"), [(25, (350, 50)), (50, (400, 0)), (100, (300, 0)), (125, (350, 50))])
def test_a_circle_passes_its_points(ready, percent, end):
    through = [350, 50, 300, *TOOL_DOWN], [400, 0, 300, *TOOL_DOWN]
    assert ready.move_circle(*through, percent=percent, speed=200, wait=False) == 0
    seen = watch(ready, lambda: reported_pose(ready)[:3], lambda: ready.get_state() == (0, 2))
    np.testing.assert_allclose(np.linalg.norm(seen - [350, 0, 300], axis=1), 50, atol=1e-3)
    np.testing.assert_allclose(reported_pose(ready)[:3], [*end, 300], atol=1e-3)


def test_points_on_a_line_make_no_circle(ready):
    assert ready.move_circle([350, 0, 300, *TOOL_DOWN], [400, 0, 300, *TOOL_DOWN], percent=50) == 0
    assert ready.get_err_warn_code() == (0, [32, 0])


def test_joint_velocities_hold_for_their_time(ready):
    before = np.array(ready.get_servo_angle()[1][:6])
    enter_mode(ready, 4)
    assert ready.vc_set_joint_velocity([0.4, 0, 0, 0, 0, -0.2], duration=0.5) == 0
    wait_until(lambda: ready.get_state() == (0, 2), 5, "the end of the command's time")
    np.testing.assert_allclose(ready.get_servo_angle()[1][:6], before + [0.2, 0, 0, 0, 0, -0.1], atol=2e-6)
    assert ready.vc_set_joint_velocity([-0.4, 0, 0, 0, 0, 0]) == 0
    wait_until(lambda: ready.get_servo_angle()[1][0] < before[0], 5, "motion until the next command")
    assert ready.vc_set_joint_velocity([0] * 6) == 0
    assert ready.get_state() == (0, 2)
    assert ready.vc_set_cartesian_velocity([10, 0, 0, 0, 0, 0]) == 10, "another mode's command"


@pytest.mark.parametrize("is_tool_coord", [False, True])
def test_tool_velocities_hold_for_their_time(ready, is_tool_coord):
    enter_mode(ready, 5)
    command = [40, 20, 10, 0, 0, 0.4]
    assert ready.vc_set_cartesian_velocity(command, is_tool_coord=is_tool_coord, duration=0.5) == 0
    wait_until(lambda: ready.get_state() == (0, 2), 5, "the end of the command's time")
    pose = reported_pose(ready)
    if is_tool_coord:  # the tool points down: its z is down, and its turn curves its way
        assert pose[2] == pytest.approx(295, abs=1e-3)
        assert pose[5] == pytest.approx(-0.2, abs=1e-5)
    else:
        np.testing.assert_allclose(pose[:3], [320, 10, 305], atol=1e-3)
        assert pose[5] == pytest.approx(0.2, abs=1e-5)


def test_a_velocity_into_a_joint_limit_ends_in_an_error_before_it(ready):
    enter_mode(ready, 4)
    assert ready.vc_set_joint_velocity([0, 0, 3, 0, 0, 0]) == 0
    wait_until(lambda: ready.get_state() == (0, 4), 10, "a stop")
    assert ready.get_err_warn_code() == (0, [23, 0])
    assert ready.get_servo_angle()[1][2] <= 0.191986


@pytest.fixture
def reducible(ready):
    yield ready
    ready.set_reduced_tcp_boundary([9999, -9999] * 3)
    ready.set_reduced_max_tcp_speed(1000)
    ready.set_reduced_max_joint_speed(3.14)
    ready.set_reduced_joint_range([-6.28, 6.28] * 7)
    ready.set_reduced_mode(False)
    ready.set_fence_mode(False)


def test_reduced_mode_holds_the_arm_to_its_limits(reducible):
    api = reducible
    ranges = [-1.0, 1.0, *[-2.0, 2.0, -3.0, 0.1], *[-3.0, 3.0] * 4]
    assert api.set_reduced_max_tcp_speed(20) == 0
    assert api.set_reduced_max_joint_speed(0.25) == 0
    assert api.set_reduced_tcp_boundary([500, 200, 100, -100, 400, 100]) == 0
    assert api.set_reduced_joint_range(ranges) == 0
    assert api.get_reduced_mode() == (0, 0)
    assert api.set_reduced_mode(True) == 0
    code, (is_on, boundary, tool_speed, joint_speed, joint_ranges, fence, _) = api.get_reduced_states()
    assert (code, is_on, tool_speed, joint_speed, fence) == (0, 1, 20, 0.25, 0)
    assert boundary == [500, 200, 100, -100, 400, 100]
    assert joint_ranges[:4] == pytest.approx(ranges[:4])
    wait_until(lambda: api.is_reduced_mode and api.reduced_tcp_boundary == boundary, 5, "a report of it")

    api.set_position(300, 90, 300, *TOOL_DOWN, speed=500, mvacc=2000)
    speeds = watch(api, lambda: api.realtime_tcp_speed, lambda: api.get_state() == (0, 2))
    assert 15 < speeds.max() < 20.5
    api.set_servo_angle(servo_id=1, angle=-0.25, speed=3)
    speeds = watch(api, lambda: api.get_joint_states()[1][1][0], lambda: api.get_state() == (0, 2))
    assert -speeds.min() == pytest.approx(0.25, abs=1e-3)

    for move, error in [
        (lambda: api.set_position(300, 150, 300, *TOOL_DOWN), 35),
        (lambda: api.set_servo_angle(servo_id=6, angle=3.1), 23),
    ]:
        assert move() == 0
        assert api.get_err_warn_code() == (0, [error, 0])
        api.clean_error()
        api.set_state(0)
    wait_until(lambda: api.error_code == 0, 5, "a report without the error")
    api.set_reduced_mode(False)
    assert api.set_position(300, 150, 300, *TOOL_DOWN, speed=1000, wait=True) == 0


def test_the_safety_boundary_alone(reducible):
    reducible.set_reduced_tcp_boundary([500, 200, 100, -100, 400, 100])
    reducible.set_fence_mode(True)
    assert reducible.set_position(300, 150, 300, *TOOL_DOWN) == 0
    assert reducible.get_err_warn_code() == (0, [35, 0])


def test_a_pause_is_queued(ready):
    ready.set_position(300, 20, 300, *TOOL_DOWN, speed=500)
    assert ready.set_pause_time(20) == 0
    ready.set_position(300, 40, 300, *TOOL_DOWN, speed=500)
    wait_until(lambda: ready.get_cmdnum() == (0, 2), 5, "the end of the first line")
    for _ in range(50):
        assert reported_pose(ready)[1] == pytest.approx(20, abs=1e-3)
    assert ready.get_state() == (0, 1), "a queue that waits is still under way"
    wait_until(lambda: ready.get_state() == (0, 2), 10, "the second line")
    assert reported_pose(ready)[1] == pytest.approx(40, abs=1e-3)


def test_joint_states_are_true_during_motion(ready):
    ready.set_servo_angle(servo_id=1, angle=2.0, speed=0.5, mvacc=20)
    speeds = watch(ready, lambda: ready.get_joint_states()[1][1], lambda: ready.get_servo_angle()[1][0] > 1.0)
    assert speeds[-1, 0] == pytest.approx(0.5, abs=1e-3)
    np.testing.assert_allclose(speeds[:, 1:], 0, atol=1e-6)
    ready.set_state(3)
    assert ready.get_state() == (0, 3)
    joints = ready.get_servo_angle()[1][:6]
    assert 1.0 < joints[0] < 2.0
    np.testing.assert_allclose(ready.get_joint_states()[1][0][:6], joints, atol=1e-6)
    np.testing.assert_allclose(reported_pose(ready)[:3], ready.get_forward_kinematics(joints)[1][:3], atol=1e-3)
