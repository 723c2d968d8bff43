"""The emulator as SDK users meet it: XArmAPI unchanged, its return codes, states and reports."""

import re
import time

import numpy as np
import pytest

from tests.xarm_bridge.emulator_process import TOOL_DOWN as DOWN
from tests.xarm_bridge.emulator_process import reported_pose as position
from tests.xarm_bridge.emulator_process import wait_until


def test_the_sdk_sees_an_xarm6(start_emulator, connect_api):
    apis = [connect_api(start_emulator()) for _ in range(2)]
    for api in apis:
        assert (api.axis, api.device_type, api.version_number) == (6, 6, (2, 5, 0))
        assert api.get_state() == (0, 4), "an arm that was just switched on is stopped"
        told_at_connecting = api.sn
        assert api.get_robot_sn() == (0, told_at_connecting)
        assert re.fullmatch("XI1300EMU[0-9A-F]{8}", api.sn)
        assert re.fullmatch("AC1300EMU", api.control_box_sn)
    assert apis[0].sn != apis[1].sn


def test_absolute_and_relative_lines(ready):
    assert ready.set_position(420, 80, 250, *DOWN, speed=200, wait=True) == 0
    np.testing.assert_allclose(position(ready)[:3], [420, 80, 250], atol=1e-3)
    assert ready.set_position(x=-20, z=15, relative=True, wait=True) == 0
    np.testing.assert_allclose(position(ready)[:3], [400, 80, 265], atol=1e-3)
    assert ready.set_tool_position(z=15, wait=True) == 0
    np.testing.assert_allclose(position(ready)[:3], [400, 80, 250], atol=1e-3)


def test_queued_lines_run_one_after_the_other(ready):
    for y in (40, 80, 120):
        assert ready.set_position(400, y, 250, *DOWN, radius=5, speed=20, wait=False) == 0
    assert ready.get_cmdnum()[1] >= 2
    wait_until(lambda: ready.get_cmdnum() == (0, 0) and ready.get_state() == (0, 2), 10, "end of the queue")
    np.testing.assert_allclose(position(ready)[:3], [400, 120, 250], atol=1e-3)


def test_joint_moves_agree_with_the_kinematics(ready):
    joints = [0.2, -0.3, -0.6, 0.1, 0.9, 0.4]
    assert ready.set_servo_angle(angle=joints, speed=1, wait=True) == 0
    np.testing.assert_allclose(ready.get_servo_angle()[1][:6], joints, atol=1e-6)
    np.testing.assert_allclose(position(ready), ready.get_forward_kinematics(joints)[1], atol=1e-3)
    assert ready.move_gohome(wait=True) == 0
    np.testing.assert_allclose(position(ready)[:3], [207, 0, 112], atol=1e-3)


def test_inverse_kinematics_and_limits(ready):
    pose = [400, 50, 300, 3.1, 0.1, 0.2]
    code, joints = ready.get_inverse_kinematics(pose)
    assert code == 0
    np.testing.assert_allclose(ready.get_forward_kinematics(joints)[1], pose, atol=2e-3)
    far = [900, 0, 300, *DOWN]
    assert ready.get_inverse_kinematics(far)[0] == 10
    assert ready.is_tcp_limit(far) == (0, True)
    assert ready.is_tcp_limit(pose) == (0, False)
    assert ready.is_joint_limit([0, 0, 1.0, 0, 0, 0]) == (0, True)


def test_servo_mode_runs_the_newest_target(ready):
    assert [ready.set_mode(1), ready.set_state(0)] == [0, 0]
    start = position(ready)
    target = start.copy()
    for _ in range(20):
        target[0] -= 2
        assert ready.set_servo_cartesian(list(target)) == 0
        time.sleep(0.01)
    wait_until(lambda: abs(position(ready)[0] - (start[0] - 40)) < 1e-3, 5, "arrival")
    target[0] += 11
    assert ready.set_servo_cartesian(list(target)) == 0
    assert position(ready)[0] == pytest.approx(start[0] - 40, abs=1e-3), "steps above 10 mm are not executed"


def test_a_mode_change_needs_state_0(ready):
    ready.set_mode(1)
    assert ready.get_state() == (0, 5)
    assert ready.set_servo_cartesian([400, 0, 250, *DOWN]) == 9
    ready.set_state(0)
    assert ready.get_state() == (0, 2)
    wait_until(lambda: ready.mode == 1, 5, "mode 1 in the reports")
    assert ready.set_position(400, 0, 250, *DOWN) == 10, "a line is refused in servo mode"


def test_motion_is_refused_when_the_motors_are_off(ready):
    ready.motion_enable(False)
    ready.set_state(0)
    assert ready.set_position(400, 0, 250, *DOWN) == 9


def test_pause_and_resume(ready):
    ready.set_position(400, 100, 250, *DOWN, speed=10)
    wait_until(lambda: ready.get_state() == (0, 1), 5, "motion")
    ready.set_state(3)
    assert ready.get_state() == (0, 3)
    paused = position(ready)
    time.sleep(0.05)
    np.testing.assert_allclose(position(ready), paused)
    ready.set_state(0)
    wait_until(lambda: ready.get_state() == (0, 2), 10, "end of the move")
    np.testing.assert_allclose(position(ready)[:3], [400, 100, 250], atol=1e-3)


def test_emergency_stop_forgets_the_queue(ready):
    for y in (100, -100):
        ready.set_position(400, y, 250, *DOWN, speed=10)
    ready.emergency_stop()
    assert ready.get_state() == (0, 4)
    assert ready.get_cmdnum() == (0, 0)
    stopped = position(ready)
    ready.set_state(0)
    time.sleep(0.05)
    np.testing.assert_allclose(position(ready), stopped)


def test_an_unreachable_line_is_a_kinematic_error(ready):
    before = position(ready)
    assert ready.set_position(900, 0, 300, *DOWN, wait=True) in (1, 9, -9)  # whichever the SDK notices first
    assert ready.get_err_warn_code() == (0, [21, 0])
    np.testing.assert_allclose(position(ready), before)
    assert ready.set_state(0) == 0
    assert ready.get_state() == (0, 4), "an error outlives set_state(0)"
    assert ready.set_position(400, 0, 250, *DOWN) == 1
    assert ready.clean_error() == 0
    ready.set_state(0)
    wait_until(lambda: ready.error_code == 0, 5, "a report without the error")
    assert ready.set_position(400, 0, 250, *DOWN, wait=True) == 0


def test_the_gripper(ready):
    assert [ready.set_gripper_enable(True), ready.set_gripper_mode(0), ready.set_gripper_speed(3000)] == [
        0,
        0,
        0,
    ]
    assert ready.set_gripper_position(300, wait=True) == 0
    assert ready.get_gripper_position() == (0, 300)
    assert ready.get_gripper_version() == (0, "3.4.3")
    assert ready.get_gripper_err_code() == (0, 0)


def test_clients_see_what_others_write_into_the_user_defined_registers(shared_emulator, connect_api):
    first, second = connect_api(shared_emulator), connect_api(shared_emulator)
    assert first.write_multiple_holding_registers(0x110, [1, 0xFFFF, 3]) == 0
    assert second.read_holding_registers(0x110, 3) == (0, [1, 0xFFFF, 3])
    assert second.write_single_holding_register(0x111, 4) == 0
    assert first.read_holding_registers(0x111, 1) == (0, [4])
    assert first.write_single_holding_register(0x20, 1) == 0x82, "the robot's mode is not for users"


def test_a_tcp_offset_moves_the_reported_pose(ready):
    before = position(ready)
    assert ready.set_tcp_offset([0, 0, 172, 0, 0, 0]) == 0
    ready.set_state(0)
    np.testing.assert_allclose(position(ready)[:3], before[:3] - [0, 0, 172], atol=1e-3)


def test_states_and_errors_are_seen_in_the_reports(start_emulator, connect_api):
    api = connect_api(start_emulator("--fault", "error=31@0.1"))
    states, errors = [], []
    api.register_state_changed_callback(lambda item: states.append(item["state"]))
    api.register_error_warn_changed_callback(lambda item: errors.append(item["error_code"]))
    api.motion_enable(True)
    api.set_state(0)
    api.set_position(400, 100, 250, *DOWN, speed=10)
    wait_until(lambda: 31 in errors and states[-1:] == [4], 10, "error and stop in the reports")
    assert api.motor_enable_states[:6] == [1] * 6, "a collision stops the arm, its motors stay on"


@pytest.mark.parametrize("kind", ["normal", "real"])
def test_the_other_report_ports(shared_emulator, connect_api, kind):
    api = connect_api(shared_emulator, report_type=kind)
    wait_until(lambda: np.allclose(api.position, position(api), atol=1e-3), 5, "the pose in a report")


def test_ctrl_c_ends_it_quietly(start_emulator):
    assert start_emulator().interrupt() == 0
