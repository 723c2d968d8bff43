"""mppi_planner_node and twin_node as installed processes: plan, cancel, refuse, lose the twin node."""

import json
import re
import threading
from functools import partial

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from egophys_msgs.action import PlanToTarget
from egophys_msgs.msg import BuildJob, WaypointPlan
from egophys_msgs.srv import RebuildTwin
from egophys_ros_common.conversions import plan_message, points_message
from egophys_ros_common.processes import MESSAGE_TIMEOUT
from egophys_ros_common.qos import latched
from nav_msgs.msg import Path
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from egophys_core.planning import (
    PlanOptions,
    final_shapes,
    grasp_from_points,
    plan_to_target,
    rollout_plans,
    twin_costs,
)
from egophys_core.recording import xyz_of_message
from egophys_core.waypoint_plan import plan_of_message
from tests.ros.cloth import SEED, lifting_plan
from tests.ros.jobs import wait_for_job

pytestmark = pytest.mark.ros

NODE = "/mppi_planner_node"
PLAN = f"{NODE}/plan_to_target"
OPTIONS = PlanOptions(waypoints=2, segment_s=0.5, settle_s=0.3, samples=8, iterations=4, noise_m=0.05)
OPTIONS_JSON = json.dumps(
    {"waypoints": 2, "segment_s": 0.5, "settle_s": 0.3, "samples": 8, "iterations": 4, "noise_m": 0.05}
)
ENDLESS_JSON = '{"iterations": 10000}'


@pytest.fixture(scope="session")
def target(twin):
    """The cloth held up by its corner."""
    plan = lifting_plan(grasp_from_points(twin.grasp), 0.08)
    return final_shapes(twin, rollout_plans(twin, [plan]))[0]


def start_planner(start, client):
    """An active planner."""
    planner = start("egophys_planner", "mppi_planner_node", "--ros-args", "-p", "autostart:=true")
    client.wait_for_state(NODE, "active")
    return planner


@pytest.fixture(scope="class")
def planner(twin_node, start_shared_node, client):
    """A planner with the twin of a twin node, shared by the tests of a class."""
    planner = start_planner(start_shared_node, client)
    wait_for_twin(client)
    return planner


def wait_for_twin(client, twin_id=""):
    """Wait until the planner says in its health which twin it has."""

    def has_it(message):
        values = {each.key: each.value for each in message.status[0].values}
        have = values.get("twin id", "")
        return message.status[0].name == NODE and (have == twin_id if twin_id else have)

    client.message(DiagnosticArray, "/diagnostics", has_it)


def goal(target, options=OPTIONS_JSON, twin_id=""):
    points = points_message(target, ids=np.arange(len(target)))
    return PlanToTarget.Goal(target=points, seed=SEED, options_json=options, twin_id=twin_id)


def start_endless(client, target):
    """Send a goal that takes minutes; its handle, once an iteration is done."""
    under_way = threading.Event()
    handle = client.send_goal(PlanToTarget, PLAN, goal(target, ENDLESS_JSON), lambda _: under_way.set())
    assert handle.accepted
    assert under_way.wait(MESSAGE_TIMEOUT), "no feedback"
    return handle


class TestPlanning:
    def test_the_plan_is_that_of_an_in_process_call_bit_for_bit(self, planner, client, twin, target):
        seen = []
        handle = client.send_goal(PlanToTarget, PLAN, goal(target, twin_id=twin.twin_id), seen.append)
        assert handle.accepted
        ended = client.result(handle)
        assert ended.status == GoalStatus.STATUS_SUCCEEDED, ended.result.message
        assert (ended.result.success, ended.result.reached, ended.result.start) == (True, True, "twin")
        assert "begins at twin (the object has not been seen: no message on /object/points" in ended.result.message
        plan = ended.result.plan
        assert plan.predicted_cost < 0.85 * ended.result.initial_cost
        assert [each.iteration for each in seen] == [1, 2, 3, 4]
        assert seen[-1].best_cost == plan.predicted_cost

        forward = partial(twin_costs, twin, target=target)
        expected, initial_cost = plan_to_target(
            forward, grasp_from_points(twin.grasp), OPTIONS, seed=SEED, twin_id=twin.twin_id
        )
        assert plan == plan_message(expected, plan.header.stamp)
        assert ended.result.initial_cost == initial_cost
        assert forward([plan_of_message(plan)])[0] == plan.predicted_cost

        latest = partial(client.message, qos=latched())
        assert latest(WaypointPlan, f"{NODE}/plan") == plan
        path = latest(Path, f"{NODE}/path")
        assert [each.pose for each in path.poses] == plan.poses
        assert path.header.frame_id == "world"
        problem = json.loads(latest(String, f"{NODE}/problem").data)
        assert (problem["seed"], problem["twin_id"]) == (SEED, twin.twin_id)
        assert problem["options"]["waypoints"] == 2
        np.testing.assert_array_equal(xyz_of_message(latest(PointCloud2, f"{NODE}/target"), source=""), target)
        start = xyz_of_message(latest(PointCloud2, f"{NODE}/start"), source="")
        np.testing.assert_array_equal(start, twin.model.graph.positions)
        np.testing.assert_array_equal(np.float32(problem["grasp_m"]), twin.grasp)

    def test_a_target_as_text_is_the_same_as_its_points(self, planner, client, target, tmp_path):
        np.save(tmp_path / "a target.npy", target)
        asked = PlanToTarget.Goal(target_source=str(tmp_path / "a target.npy"), seed=SEED, options_json=OPTIONS_JSON)
        one = client.result(client.send_goal(PlanToTarget, PLAN, asked)).result
        other = client.result(client.send_goal(PlanToTarget, PLAN, goal(target))).result
        assert one.success, one.message
        assert one.plan.poses == other.plan.poses

    def test_a_plan_that_does_not_reach_its_target_is_no_success(self, planner, client, target):
        before = client.message(WaypointPlan, f"{NODE}/plan", qos=latched())
        far = goal(target + np.float32([0, 0, 1.0]))
        ended = client.result(client.send_goal(PlanToTarget, PLAN, far))
        assert ended.status == GoalStatus.STATUS_ABORTED
        assert (ended.result.success, ended.result.reached) == (False, False)
        assert re.search(
            r"the best plan ends \d+.\d mm from it, tolerated are 30.0 mm \(\d+.\d mm without", ended.result.message
        )
        assert len(ended.result.plan.poses) > 2
        assert client.message(WaypointPlan, f"{NODE}/plan", qos=latched()) == before
        far.tolerance_m = 1.0
        ended = client.result(client.send_goal(PlanToTarget, PLAN, far))
        assert (ended.status, ended.result.reached) == (GoalStatus.STATUS_SUCCEEDED, True)

    def test_one_goal_at_a_time_and_it_can_be_canceled(self, planner, client, target):
        handle = start_endless(client, target)
        refused = client.result(client.send_goal(PlanToTarget, PLAN, goal(target)))
        assert "another goal is being planned" in refused.result.message
        client.cancel(handle)
        ended = client.result(handle, timeout=10)
        assert ended.status == GoalStatus.STATUS_CANCELED
        assert "canceled" in ended.result.message
        assert client.result(client.send_goal(PlanToTarget, PLAN, goal(target))).result.success

    def test_goals_that_make_no_sense_are_aborted_with_the_reason(self, planner, client, target):
        other = points_message(target, ids=np.arange(len(target)))
        other.header.frame_id = "camera"
        for illegal, reason in (
            (goal(target, twin_id="0123456789abcdef"), "twin 0123456789abcdef is not in use"),
            (goal(target, '{"iteration": 3}'), "did you mean 'iterations'?"),
            (goal(target, '{"low_m": [0, 0]}'), "low_m must be 3 numbers, got [0, 0]"),
            (goal(target[:0]), "the goal has no target"),
            (goal(1000 * target), "points must be in metres"),
            (goal(np.full_like(target, np.nan)), "36 of 36 points are not finite"),
            (PlanToTarget.Goal(target=other), "the points are in frame 'camera'"),
            (PlanToTarget.Goal(target_source="no.ply"), "cannot read target no.ply"),
            (PlanToTarget.Goal(target_source="present translat=0,0,1"), "unknown edit translat="),
            (PlanToTarget.Goal(target_source="present rotate=0,0,9", start="there"), "start must be present, twin or"),
            (PlanToTarget.Goal(target_source="present rotate=0,0,9", start="present"), "the object has not been seen"),
            (PlanToTarget.Goal(target_source="present rotate=0,0,9", tolerance_m=-1.0), "tolerance_m must be in"),
        ):
            ended = client.result(client.send_goal(PlanToTarget, PLAN, illegal))
            assert ended.status == GoalStatus.STATUS_ABORTED
            assert not ended.result.success
            assert reason in ended.result.message
        ended = client.result(client.send_goal(PlanToTarget, PLAN, goal(target, '{"low_m": [0.19, 0.39, 0.49]}')))
        assert ended.status == GoalStatus.STATUS_ABORTED
        assert "outside the tool's box" in ended.result.message

    def test_ctrl_c_while_planning(self, planner, client, target):
        start_endless(client, target)
        assert planner.interrupt() == 0, planner.output
        assert "Traceback" not in planner.output


def test_a_plan_fails_clearly_when_the_twin_changes_or_goes(
    start_node, start_twin_node, client, bag, target, twin_file, tmp_path
):
    twin_node = start_twin_node(twin_file)
    start_planner(start_node, client)
    wait_for_twin(client)
    handle = start_endless(client, target)
    request = RebuildTwin.Request(
        episode_paths=[str(bag)],
        output_path=str(tmp_path / "other.twin"),
        options_json='{"generations": 1, "population": 2, "dense_steps": 0}',
    )
    assert client.call(RebuildTwin, "/twin_node/rebuild", request).accepted
    job = wait_for_job(client, BuildJob.SUCCEEDED)
    ended = client.result(handle)
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert "is not in use" in ended.result.message

    # The new twin is taken up without being told.
    new_id = job.message.split()[2].rstrip(":")
    wait_for_twin(client, new_id)
    again = start_endless(client, target)
    assert twin_node.interrupt() == 0, twin_node.output
    ended = client.result(again, timeout=30)
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert "rollout service /twin_node/rollout" in ended.result.message


def test_without_a_twin_a_goal_is_aborted_with_the_reason(start_node, client, target):
    planner = start_planner(start_node, client)
    ended = client.result(client.send_goal(PlanToTarget, PLAN, goal(target)))
    assert "no twin received on /twin_node/model" in ended.result.message
    assert planner.interrupt() == 0, planner.output
