"""bridge_node and emulator as installed processes over DDS: plans, refusals, stop, cancel, recovery."""

import dataclasses
import itertools
import os
import threading
import time
from pathlib import Path

import nav_msgs.msg
import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from egophys_msgs.action import ExecutePlan
from egophys_ros_common.conversions import plan_message, time_message
from egophys_ros_common.processes import MESSAGE_TIMEOUT, wait_until
from egophys_ros_common.qos import latched
from geometry_msgs.msg import PoseStamped, TransformStamped
from lifecycle_msgs.msg import Transition
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger
from xarm_bridge.kinematics import forward

from egophys_core.plan_file import PlanFile, write_plan
from egophys_core.robot import Calibration, Transform
from egophys_core.waypoint_plan import WaypointPlan

pytestmark = pytest.mark.ros

CONFIG = Path(__file__).resolve().parents[2] / "ros2_ws/src/xarm_bridge/config"
CALIBRATION = CONFIG / "world_to_base.yaml"
NODE = "/bridge_node"
EXECUTE = f"{NODE}/execute"
ADDRESSES = (f"127.{101 + os.getpid() // 256 % 100}.{os.getpid() % 256}.{index}" for index in itertools.count(2))


def make_plan(positions, times):
    return WaypointPlan(
        times=np.array(times, float),
        positions=np.array(positions, float),
        quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (len(times), 1)),
        gripper_opening=np.full(len(times), 0.05),
        twin_id="",
        predicted_cost=0.0,
    )


SHORT = make_plan([[-0.1, 0.0, 0.12], [0.0, 0.0, 0.12], [0.0, 0.1, 0.12]], [0.0, 0.6, 1.2])
LONG = make_plan([[-0.1, 0.0, 0.12], [0.1, 0.2, 0.12]], [0.0, 15.0])


def goal(plan, age_s=0.0):
    return ExecutePlan.Goal(plan=plan_message(plan, time_message(time.time_ns() - round(age_s * 1e9))))


def execute(client, plan, **fields):
    """What the goal of a plan ends with."""
    return client.act(ExecutePlan, EXECUTE, goal(plan, **fields))


def position(message):
    point = message.pose.position
    return np.array([point.x, point.y, point.z])


@pytest.fixture
def bridge(start_node):
    """Emulator and bridge, configured with the files that are shipped; not started yet."""
    address = next(ADDRESSES)

    def start(*emulator_arguments, **parameters):
        emulator = start_node("xarm_bridge", "emulator", "--host", address, *emulator_arguments)
        emulator.wait_for_output("ready on")
        values = {"robot_ip": address, "allow_emulator": True, "calibration_file": CALIBRATION, **parameters}
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        file = str(CONFIG / "bridge.yaml")
        node = start_node("xarm_bridge", "bridge_node", "--ros-args", "--params-file", file, *words)
        return node, emulator

    return start


def start_long_plan(client):
    """Send the long plan; its handle, once it is under way."""
    moving = threading.Event()
    handle = client.send_goal(
        ExecutePlan, EXECUTE, goal(LONG), lambda feedback: feedback.progress > 0.02 and moving.set()
    )
    assert handle.accepted
    assert moving.wait(MESSAGE_TIMEOUT), "no feedback of the plan's progress"
    return handle


def test_a_plan_is_executed_and_measured(bridge, client):
    bridge()
    client.start(NODE)
    shares = []
    handle = client.send_goal(ExecutePlan, EXECUTE, goal(SHORT), lambda each: shares.append(each.progress))
    assert handle.accepted
    ended = client.result(handle)
    assert ended.status == GoalStatus.STATUS_SUCCEEDED
    assert ended.result.success
    path = np.array([position(pose) for pose in ended.result.executed.poses])
    for waypoint in SHORT.positions:
        assert np.linalg.norm(path - waypoint, axis=1).min() < 0.006
    stamps = [pose.header.stamp.sec + 1e-9 * pose.header.stamp.nanosec for pose in ended.result.executed.poses]
    assert stamps == sorted(stamps)
    assert ended.result.executed.header.frame_id == "world"
    assert ended.result.gripper_opening_m[-1] == pytest.approx(0.05, abs=1e-3)
    assert shares == sorted(shares)
    np.testing.assert_allclose(
        position(client.message(PoseStamped, f"{NODE}/tool_pose")), SHORT.positions[-1], atol=1e-4
    )
    # What was executed reaches who comes late.
    assert client.message(nav_msgs.msg.Path, f"{NODE}/executed", qos=latched()) == ended.result.executed
    assert client.message(Float64, f"{NODE}/gripper_command", qos=latched()).data == 0.05


def test_it_tells_where_the_robot_stands_and_what_it_looks_like(bridge, client):
    bridge()
    client.start(NODE)
    assert "link_base" in client.message(String, "/robot_description", qos=latched()).data
    joints = client.message(JointState, "/joint_states")
    assert list(joints.name) == [f"joint{number}" for number in range(1, 7)]
    tool = position(client.message(PoseStamped, f"{NODE}/tool_pose"))
    calibration = Calibration.load(CALIBRATION)
    flange = forward(np.array(joints.position))
    tcp = Transform(rotation=flange.rotation.as_matrix(), translation=flange.position / 1000.0)
    np.testing.assert_allclose(calibration.tool_in_world(tcp).translation, tool, atol=1e-5)
    message = client.message(TransformStamped, f"{NODE}/world_to_base", qos=latched())
    assert (message.header.frame_id, message.child_frame_id) == ("world", "link_base")
    base = Calibration.load(CALIBRATION).world_to_base.inverse().translation
    translation = message.transform.translation
    np.testing.assert_allclose([translation.x, translation.y, translation.z], base, atol=1e-12)


@pytest.mark.parametrize(
    ("index", "value", "reason"),
    [(1, [0.0, 0.0, 0.6], "waypoint 1"), (2, [0.0, np.nan, 0.12], "not finite")],
    ids=["outside", "nan"],
)
def test_an_illegal_plan_is_rejected_and_nothing_moves(bridge, client, index, value, reason):
    bridge()
    client.start(NODE)
    before = position(client.message(PoseStamped, f"{NODE}/tool_pose"))
    positions = SHORT.positions.copy()
    positions[index] = value
    ended = execute(client, dataclasses.replace(SHORT, positions=positions))
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert reason in ended.result.message
    client.message(
        DiagnosticArray,
        "/diagnostics",
        lambda array: any(reason in status.message for status in array.status),
    )
    after = position(client.message(PoseStamped, f"{NODE}/tool_pose"))
    np.testing.assert_allclose(after, before, atol=1e-6)


def test_stop_in_the_middle_of_a_plan(bridge, client):
    bridge()
    client.start(NODE)
    handle = start_long_plan(client)
    assert "another plan is being executed" in execute(client, SHORT).result.message
    answer = client.call(Trigger, f"{NODE}/stop")
    assert answer.success, answer.message
    ended = client.result(handle)
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert not ended.result.success
    halted = position(ended.result.executed.poses[-1])
    assert np.linalg.norm(halted - LONG.positions[-1]) > 0.1
    np.testing.assert_allclose(position(client.message(PoseStamped, f"{NODE}/tool_pose")), halted, atol=1e-4)
    after = execute(client, SHORT)
    assert after.result.success, after.result.message


def test_cancel_in_the_middle_of_a_plan(bridge, client):
    bridge()
    client.start(NODE)
    handle = start_long_plan(client)
    client.cancel(handle)
    ended = client.result(handle)
    assert ended.status == GoalStatus.STATUS_CANCELED
    assert len(ended.result.executed.poses) > 0


def test_stop_works_while_inactive(bridge, client):
    bridge()
    assert client.change_state(NODE, Transition.TRANSITION_CONFIGURE)
    answer = client.call(Trigger, f"{NODE}/stop")
    assert answer.success, answer.message
    assert "not active" in execute(client, SHORT).result.message


def test_a_controller_error_is_told_and_cleared(bridge, client):
    bridge("--fault", "error=31@3")
    client.start(NODE)
    ended = execute(client, LONG)
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert "controller error 31" in ended.result.message
    answer = client.call(Trigger, f"{NODE}/clear_error")
    assert answer.success, answer.message
    after = execute(client, SHORT)
    assert after.result.success, after.result.message


def test_deactivating_stops_the_arm_and_cleanup_allows_another_start(bridge, client):
    node, _ = bridge()
    client.start(NODE)
    start_long_plan(client)
    assert client.change_state(NODE, Transition.TRANSITION_DEACTIVATE)
    assert client.change_state(NODE, Transition.TRANSITION_CLEANUP)
    client.start(NODE)
    ended = execute(client, SHORT)
    assert ended.result.success, ended.result.message
    ended = start_long_plan(client).get_result_async()
    assert node.interrupt() == 0, "Ctrl-C in the middle of a plan"
    wait_until(ended.done, 10, "the goal's result, from the bridge that was told to end")
    assert "stopped before the end" in ended.result().result.message


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("calibration_file", "/nowhere.yaml"),
        ("robot_ip", "127.200.0.1"),
        ("max_speed_m_s", "0.5"),
        ("allow_emulator", "false"),
        ("driver", "xarm_bridge.xarm7:XArm7"),
    ],
)
def test_a_configuration_that_cannot_work_is_refused(bridge, client, parameter, value):
    node, _ = bridge(**{parameter: value, "connect_patience_s": 0.0})
    assert not client.change_state(NODE, Transition.TRANSITION_CONFIGURE)
    assert client.state_of(NODE) == "unconfigured"
    assert "cannot configure" in node.output


def test_it_starts_by_itself_and_waits_for_the_controller(start_node, client):
    """As the launch file starts both: at once, and with the ROS arguments that launch appends."""
    address = next(ADDRESSES)
    values = {"robot_ip": address, "allow_emulator": True, "calibration_file": CALIBRATION, "autostart": True}
    words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    start_node("xarm_bridge", "bridge_node", "--ros-args", *words)
    start_node("xarm_bridge", "emulator", "--host", address, "--ros-args", "-r", "__node:=emulator")
    client.wait_for_state(NODE, "active")


def test_a_plan_file_is_executed_and_old_or_foreign_plans_are_not(bridge, client, tmp_path):
    bridge()
    client.start(NODE)
    path = tmp_path / "plan.json"
    plan = dataclasses.replace(SHORT, twin_id="fedcba9876543210")
    write_plan(path, PlanFile(plan=plan, stamp_ns=time.time_ns(), tolerance=0.01))
    assert client.act(ExecutePlan, EXECUTE, ExecutePlan.Goal(plan_file=str(path))).result.success
    asked = ExecutePlan.Goal(plan_file=str(tmp_path / "absent.json"))
    assert "cannot read plan" in client.act(ExecutePlan, EXECUTE, asked).result.message
    assert "made 3600 s ago, at most 300 s" in execute(client, SHORT, age_s=3600.0).result.message
    unstamped = ExecutePlan.Goal(plan=plan_message(SHORT))
    assert "does not say when it was made" in client.act(ExecutePlan, EXECUTE, unstamped).result.message
    assert client.set_parameter(NODE, "max_plan_age_s", 0.0).successful, "it is read for each plan"
    assert client.act(ExecutePlan, EXECUTE, unstamped).result.success


def test_limits_and_address_are_not_changed_under_way(bridge, client):
    bridge()
    client.start(NODE)
    for name, value in (("max_speed_m_s", 0.1), ("robot_ip", "127.9.9.9"), ("workspace_max_m", [0.5, 0.1, 0.2])):
        refused = client.set_parameter(NODE, name, value)
        assert not refused.successful
        assert "deactivate first" in refused.reason
    assert client.change_state(NODE, Transition.TRANSITION_DEACTIVATE)
    assert client.set_parameter(NODE, "max_speed_m_s", 0.1).successful
    assert client.change_state(NODE, Transition.TRANSITION_ACTIVATE)
    assert "speed 0.167 m/s exceeds 0.1 m/s" in execute(client, SHORT).result.message


def test_stop_works_before_the_bridge_is_configured(bridge, client):
    bridge()
    client.wait_for_state(NODE, "unconfigured")
    answer = client.call(Trigger, f"{NODE}/stop")
    assert answer.success, answer.message


def test_a_dead_controller_ends_the_plan_with_a_message(bridge, client):
    _, emulator = bridge()
    client.start(NODE)
    handle = start_long_plan(client)
    emulator.kill()
    ended = client.result(handle)
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert "127." in ended.result.message
    answer = client.call(Trigger, f"{NODE}/stop")
    assert not answer.success
    assert "emergency stop button" in answer.message
