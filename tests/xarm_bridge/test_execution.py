"""Arm and SDK against the emulator process: plans, stops and failures."""

import dataclasses
import subprocess
import sys
import threading

import numpy as np
import pytest
from xarm_bridge.xarm6 import XArm6

from egophys_core.errors import ArmLostError, RobotError
from egophys_core.robot import ArmTakenError, Ownership
from tests.xarm_bridge.emulator_process import PACKAGE, make_plan

SQUARE = make_plan(
    [[0.0, 0.0, 0.1], [0.1, 0.0, 0.1], [0.1, 0.1, 0.15], [0.0, 0.1, 0.1]],
    [0.0, 0.5, 1.2, 1.9],
)
LONG = make_plan([[0.0, 0.0, 0.1], [0.1, 0.2, 0.1]], [0.0, 8.0])


def run_in_thread(arm, plan, stop=None):
    """Start a plan; a list for the motion or the error, the thread, and an event set once it moves."""
    outcome, moving = [], threading.Event()

    def execute():
        try:
            outcome.append(
                arm.executor.execute(plan, stop=stop, on_progress=lambda share, _: share > 0.1 and moving.set())
            )
        except RobotError as error:
            outcome.append(error)

    thread = threading.Thread(target=execute)
    thread.start()
    return outcome, thread, moving


def test_a_plan_is_executed_in_its_own_time(shared_arm):
    shares = []
    executed = shared_arm.executor.execute(SQUARE, on_progress=lambda share, _: shares.append(share))
    assert executed.completed
    # The tool passes every waypoint: a measured position is within one sample of travel at 0.25 m/s.
    for waypoint in SQUARE.positions:
        assert np.linalg.norm(executed.positions - waypoint, axis=1).min() < 0.006
    np.testing.assert_allclose(executed.positions[-1], SQUARE.positions[-1], atol=1e-4)
    np.testing.assert_allclose(np.abs(executed.quaternions @ SQUARE.quaternions[0]), 1.0, atol=1e-5)
    assert np.all(np.diff(executed.times) > 0)
    assert executed.times[-1] >= SQUARE.times[-1]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    np.testing.assert_allclose(shared_arm.executor.tool_pose().translation, SQUARE.positions[-1], atol=1e-4)


def test_the_gripper_follows_the_plan(shared_arm):
    plan = dataclasses.replace(SQUARE, gripper_opening=np.array([0.085, 0.085, 0.02, 0.02]))
    executed = shared_arm.executor.execute(plan)
    assert executed.gripper_opening[0] == pytest.approx(0.085, abs=1e-3)
    assert executed.gripper_opening[-1] == pytest.approx(0.02, abs=1e-3)


def test_a_second_plan_runs_after_the_first(shared_arm):
    plan = make_plan([[0.0, 0.0, 0.1], [0.05, 0.0, 0.1]], [0.0, 0.4])
    back = make_plan([[0.05, 0.0, 0.1], [0.0, 0.0, 0.1]], [0.0, 0.4])
    assert shared_arm.executor.execute(plan).completed
    assert shared_arm.executor.execute(back).completed
    np.testing.assert_allclose(shared_arm.executor.tool_pose().translation, [0.0, 0.0, 0.1], atol=1e-4)


def test_stop_from_another_thread_halts_well_before_the_goal(shared_arm):
    outcome, thread, moving = run_in_thread(shared_arm, LONG)
    assert moving.wait(20)
    shared_arm.executor.stop()
    halted = shared_arm.executor.tool_pose().translation
    thread.join(10)
    assert not outcome[0].completed
    np.testing.assert_allclose(shared_arm.executor.tool_pose().translation, halted, atol=1e-6)
    assert np.linalg.norm(halted - LONG.positions[-1]) > 0.05
    assert shared_arm.executor.execute(make_plan([[0.0, 0.0, 0.1]], [0.0])).completed, (
        "a stop must not lock the arm for good"
    )


def test_a_stop_requested_before_the_start_holds(shared_arm):
    before = shared_arm.executor.tool_pose().translation
    stop = threading.Event()
    stop.set()
    assert not shared_arm.executor.execute(LONG, stop=stop).completed
    np.testing.assert_allclose(shared_arm.executor.tool_pose().translation, before, atol=1e-6)


def test_only_one_plan_at_a_time(shared_arm):
    outcome, thread, moving = run_in_thread(shared_arm, LONG)
    assert moving.wait(20)
    with pytest.raises(RobotError, match="another plan"):
        shared_arm.executor.execute(SQUARE)
    shared_arm.executor.stop()
    thread.join(10)
    assert not outcome[0].completed


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        (make_plan([[0.0, 0.0, 0.1], [0.0, 0.0, 0.6]], [0.0, 5.0]), r"waypoint 1 .*z = 0.600 m is outside"),
        (make_plan([[0.0, 0.0, 0.1], [0.0, np.nan, 0.1]], [0.0, 5.0]), r"waypoint 1: position .* not finite"),
        (make_plan([[0.0, 0.0, 0.1], [0.1, 0.0, 0.1]], [0.0, 0.1]), r"waypoint 1 .*speed 1.000 m/s exceeds"),
        (make_plan([[0.0, 0.0, 0.1], [0.1, -0.28, 0.48]], [0.0, 9.0]), r"waypoint 1 .*cannot reach"),
    ],
    ids=["outside", "nan", "fast", "unreachable"],
)
def test_an_illegal_plan_is_refused_before_anything_moves(shared_arm, plan, reason):
    before = shared_arm.executor.tool_pose()
    with pytest.raises(RobotError, match=reason):
        shared_arm.executor.execute(plan)
    np.testing.assert_allclose(shared_arm.executor.tool_pose().translation, before.translation, atol=1e-6)


def test_a_tool_outside_the_workspace_is_not_moved(start_emulator, connect_arm):
    arm = connect_arm(start_emulator("--start", "207", "0", "112", "180", "0", "0"))
    with pytest.raises(RobotError, match=r"now stands where z = -0.060 m is outside"):
        arm.executor.execute(SQUARE)


def test_a_controller_error_is_reported_and_recoverable(start_emulator, connect_arm):
    arm = connect_arm(start_emulator("--fault", "error=31@1.5"))
    with pytest.raises(RobotError, match=r"controller error 31 \(Collision"):
        arm.executor.execute(LONG)
    assert arm.driver.error_code() == 31
    with pytest.raises(RobotError, match="error 31"):
        arm.executor.execute(SQUARE)
    arm.driver.clear_error()
    assert arm.driver.error_code() == 0
    assert arm.executor.execute(SQUARE).completed


@pytest.mark.parametrize("fault", ["killed", "silence@1.5"])
def test_a_dead_or_hung_controller_ends_in_one_error(start_emulator, connect_arm, fault):
    emulator = start_emulator(*([] if fault == "killed" else ["--fault", fault]))
    arm = connect_arm(emulator)
    outcome, thread, moving = run_in_thread(arm, LONG)
    if fault == "killed":
        assert moving.wait(20)
        emulator.kill()
    thread.join(20)
    assert not thread.is_alive()
    assert isinstance(outcome[0], RobotError)
    assert emulator.host in str(outcome[0])


def test_a_stop_that_is_not_confirmed_says_so(start_emulator, connect_arm):
    emulator = start_emulator()
    arm = connect_arm(emulator)
    emulator.kill()
    with pytest.raises(RobotError, match="press the emergency stop button"):
        arm.executor.stop()


def test_lost_status_reports_are_noticed(start_emulator, connect_arm):
    emulator = start_emulator("--fault", "no-reports@0")
    arm = connect_arm(emulator)
    # The reports end with the first motion, so the mode change after it is never seen.
    with pytest.raises(RobotError, match="did not report mode"):
        arm.executor.execute(make_plan([[0.0, 0.0, 0.1]], [0.0]))


def test_a_controller_that_hangs_between_the_two_questions_of_a_gripper_reading(
    start_emulator, connect_arm, monkeypatch
):
    """The position has come then; why nothing came after it is told all the same."""
    emulator = start_emulator("--faults-from-stdin")
    driver = connect_arm(emulator).driver
    driver.prepare_gripper()
    wire = driver._api._arm.arm_cmd
    position = wire.gripper_modbus_get_pos

    def and_then_hang():
        answer = position()
        emulator.inject("silence=5")
        return answer

    monkeypatch.setattr(wire, "gripper_modbus_get_pos", and_then_hang)
    with pytest.raises(ArmLostError, match="no answer"):
        driver.gripper_opening()


def test_nobody_at_the_address():
    with pytest.raises(RobotError, match=r"no xArm controller at 127\.200\.200\.200"):
        XArm6("127.200.200.200").connect()


def test_an_address_that_is_no_address():
    with pytest.raises(RobotError, match="no IPv4 address"):
        XArm6("ttyUSB0")


USE_AND_TELL = """
import socket, sys
sys.path.insert(0, sys.argv[2])
from xarm_bridge.xarm6 import XArm6
driver = XArm6(sys.argv[1])
driver.connect()
driver.begin_streaming()
driver.close()
print(socket.getdefaulttimeout())
"""


def test_the_sdk_leaves_the_process_alone(start_emulator):
    """No print of the SDK's on stdout, no default timeout left on other people's sockets."""
    command = [sys.executable, "-c", USE_AND_TELL, start_emulator().host, str(PACKAGE)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert result.stdout == "None\n"


def test_two_emulators_side_by_side(start_emulator, connect_arm):
    first, second = connect_arm(start_emulator()), connect_arm(start_emulator())
    untouched = second.executor.tool_pose().translation
    assert first.executor.execute(make_plan([[0.0, 0.1, 0.1]], [0.0])).completed
    np.testing.assert_allclose(first.executor.tool_pose().translation, [0.0, 0.1, 0.1], atol=1e-4)
    np.testing.assert_allclose(second.executor.tool_pose().translation, untouched, atol=1e-6)


def test_a_note_on_the_control_box_is_seen_by_other_machines(start_emulator, connect_arm):
    """The lock of a machine is by the serial number: another one stands for another machine's."""
    emulator = start_emulator()
    first, second = (
        Ownership(connect_arm(emulator).driver, f"{emulator.host}-{machine}", f"/{machine}/bridge_node")
        for machine in ("lab", "office")
    )
    first.acquire()
    assert first.is_seen_elsewhere
    with pytest.raises(ArmTakenError, match=r"is driven by /lab/bridge_node"):
        second.acquire(sleep=lambda seconds: first.renew())
    first.release()
    second.acquire(sleep=lambda seconds: None)
