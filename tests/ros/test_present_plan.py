"""Plans begin where the object is seen: the planner and the twin node over DDS, and the arm that executes the plan."""

import itertools
import json
import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from egophys_msgs.action import PlanToTarget
from egophys_msgs.msg import WaypointPlan
from egophys_msgs.srv import PlanAndExecute
from egophys_ros_common.conversions import plan_message, points_message
from egophys_ros_common.processes import wait_until
from egophys_ros_common.qos import latched
from nav_msgs.msg import Path as PathMessage
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from egophys_core.planning import (
    PlanOptions,
    Start,
    final_shapes,
    grasp_from_points,
    plan_to_target,
    rollout_plans,
    twin_costs,
)
from egophys_core.recording import xyz_of_message
from egophys_core.waypoint_plan import plan_of_message

pytestmark = pytest.mark.ros

SPACE = "/lab"
PLANNER = f"{SPACE}/mppi_planner_node"
OPTIONS = {"waypoints": 2, "segment_s": 0.5, "settle_s": 0.3, "samples": 8, "iterations": 4, "noise_m": 0.05}
OPTIONS_JSON = json.dumps(OPTIONS)
HIGHER = "present translate=0.02,0,0.03"
CALIBRATION = Path(__file__).resolve().parents[2] / "ros2_ws/src/xarm_bridge/config/world_to_base.yaml"
ADDRESSES = (f"127.{101 + os.getpid() // 256 % 100}.{os.getpid() % 256}.{index}" for index in itertools.count(150))


class Observer:
    """Publishes where the object is, ten times a second, until told otherwise."""

    def __init__(self, client, topic):
        self._node = client.node
        self._publisher = self._node.create_publisher(PointCloud2, topic, qos_profile_sensor_data)
        self.points = None
        self._timer = self._node.create_timer(0.1, self._publish)

    def _publish(self):
        if self.points is not None:
            stamp = self._node.get_clock().now().to_msg()
            points = self.points() if callable(self.points) else self.points
            self._publisher.publish(points_message(points, ids=np.arange(len(points)) + 7, stamp=stamp))

    def close(self):
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)


@pytest.fixture
def observer(client):
    made = Observer(client, f"{SPACE}/object/points")
    yield made
    made.close()


@pytest.fixture
def planner(start_node, client, twin, twin_file):
    """Twin node and planner in a namespace, with all names as they are by default."""
    space = ("-r", f"__ns:={SPACE}", "-p", "autostart:=true")
    start_node("egophys_twin", "twin_node", "--ros-args", *space, "-p", f"twin_path:='{twin_file}'")
    node = start_node("egophys_planner", "mppi_planner_node", "--ros-args", *space)
    client.wait_for_state(PLANNER, "active")
    return node


def ask(client, start="", target_source=HIGHER):
    goal = PlanToTarget.Goal(target_source=target_source, options_json=OPTIONS_JSON, seed=3, start=start)
    return client.result(client.send_goal(PlanToTarget, f"{PLANNER}/plan_to_target", goal))


def seen_plan(client, points):
    """The plan from the present state, asked for until the object is known there."""

    def planned():
        ended = ask(client, start="present")
        nodes = xyz_of_message(client.message(PointCloud2, f"{PLANNER}/start", qos=latched()), source="start")
        right = ended.status == GoalStatus.STATUS_SUCCEEDED and np.abs(nodes - points).max() < 0.01
        return (ended.result, nodes) if right else None

    return wait_until(planned, 60, "a plan from where the object is")


def wait_for_known_points(client):
    """Until the planner says that it knows points by their ids; the object may then take any shape."""

    def knows(message):
        (status,) = message.status
        return status.name == PLANNER and any("points known" in each.value for each in status.values)

    client.message(DiagnosticArray, "/diagnostics", knows)


def test_a_plan_begins_where_the_object_is_and_a_log_has_all_of_it(planner, client, twin, observer):
    wait_until(lambda: ask(client, start="twin").result.success, 30, "a plan from the twin's own shape")
    unseen = ask(client, start="present").result
    assert "the object has not been seen: no message on /lab/object/points" in unseen.message

    rest = twin.model.graph.positions
    lying = rest + np.float32([0.03, -0.04, 0.0])
    observer.points = lying
    first, nodes = seen_plan(client, lying)
    wait_for_known_points(client)
    assert first.start == "present"
    grasp = first.plan.poses[1].position
    assert [grasp.x, grasp.y] == pytest.approx(twin.grasp.mean(axis=0)[:2] + [0.03, -0.04], abs=0.006)

    # The arm has executed it; the object is where it left it, and the same request is another one.
    described = json.loads(client.message(String, f"{PLANNER}/problem", qos=latched()).data)
    start = Start(nodes=nodes, grasp=np.float32(described["grasp_m"]))
    carried = final_shapes(twin, rollout_plans(twin, [plan_of_message(first.plan)], start=start))[0]
    assert np.linalg.norm(carried - lying, axis=1).max() > 0.02
    observer.points = carried
    second, nodes = seen_plan(client, carried)
    assert second.plan.poses != first.plan.poses

    # Bit for bit from what was published.
    described = json.loads(client.message(String, f"{PLANNER}/problem", qos=latched()).data)
    target = xyz_of_message(client.message(PointCloud2, f"{PLANNER}/target", qos=latched()), source="target")
    start = Start(nodes=nodes, grasp=np.float32(described["grasp_m"]))
    again, initial_cost = plan_to_target(
        partial(twin_costs, twin, target=target, start=start),
        grasp_from_points(start.grasp),
        PlanOptions(**OPTIONS),
        seed=3,
        twin_id=twin.twin_id,
    )
    assert plan_message(again, second.plan.header.stamp) == second.plan
    assert initial_cost == second.initial_cost

    shake = itertools.cycle([0.0, 0.02])
    observer.points = lambda: carried + np.float32([next(shake), 0, 0])
    wait_until(lambda: "the object moves, by" in ask(client).result.message, 20, "a refusal of what moves")
    observer.points = None
    wait_until(lambda: "which is not now" in ask(client).result.message, 20, "a refusal of what is long ago")
    assert ask(client, start="twin").result.start == "twin"


def test_two_strings_plan_and_execute(planner, client, start_node):
    def request(target, **options):
        asked = PlanAndExecute.Request(target=target, options_json=json.dumps({**OPTIONS, **options}))
        return client.call(PlanAndExecute, f"{PLANNER}/plan_and_execute", asked, timeout=120)

    wait_until(lambda: ask(client).result.success, 30, "a plan")
    without = request(HIGHER)
    assert (without.success, without.reached) == (False, True)
    assert "no bridge serves /lab/bridge_node/execute" in without.message
    assert "unknown edit translat=" in request("present translat=0,0,1").message
    far = request("present translate=0,0,0.9")
    assert (far.success, far.reached) == (False, False)
    assert "nothing was executed: the target is not reached" in far.message
    assert far.predicted_cost > 0.03

    address = next(ADDRESSES)
    start_node("xarm_bridge", "emulator", "--host", address).wait_for_output("ready on")
    values = {"robot_ip": address, "allow_emulator": "true", "calibration_file": CALIBRATION, "autostart": "true"}
    words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    bridge = start_node("xarm_bridge", "bridge_node", "--ros-args", "-r", f"__ns:={SPACE}", *words)
    client.wait_for_state(f"{SPACE}/bridge_node", "active")
    wait_until(lambda: "no bridge serves" not in (done := request(HIGHER)).message and done, 60, "the bridge found")
    done = request(HIGHER)
    assert (done.success, done.reached) == (True, True), done.message
    assert done.predicted_cost < done.initial_cost
    executed = client.message(PathMessage, f"{SPACE}/bridge_node/executed", qos=latched())
    end, planned = executed.poses[-1].pose.position, client.message(PathMessage, f"{PLANNER}/path", qos=latched())
    aim = planned.poses[-1].pose.position
    assert [end.x, end.y, end.z] == pytest.approx([aim.x, aim.y, aim.z], abs=0.003)

    slow = {**OPTIONS, "segment_s": 10.0, "settle_s": 20.0, "samples": 2, "iterations": 1}
    asked = PlanAndExecute.Request(target="present translate=0,0,0.001", options_json=json.dumps(slow))
    pending = client.node.create_client(PlanAndExecute, f"{PLANNER}/plan_and_execute")
    answer = pending.call_async(asked)
    moving = partial(client.message, PathMessage, f"{PLANNER}/path", qos=latched())
    wait_until(
        lambda: len(moving().poses) > 0 and moving().poses[-1].header.stamp.sec - moving().header.stamp.sec > 30,
        60,
        "the slow plan",
    )
    assert "another request is being planned or executed" in request(HIGHER).message
    assert client.call(Trigger, f"{PLANNER}/cancel").success
    wait_until(answer.done, 30, "the answer of what was canceled")
    assert not answer.result().success
    assert "canceled" in answer.result().message
    assert not client.call(Trigger, f"{PLANNER}/cancel").success

    before = client.message(WaypointPlan, f"{PLANNER}/plan", qos=latched())
    answer = pending.call_async(asked)
    wait_until(lambda: client.message(WaypointPlan, f"{PLANNER}/plan", qos=latched()) != before, 60, "a new plan")
    bridge.kill()
    wait_until(answer.done, 60, "the answer without a bridge")
    assert "bridge_node/execute" in answer.result().message
    client.node.destroy_client(pending)
