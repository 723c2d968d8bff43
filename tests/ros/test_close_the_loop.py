"""The loop over real nodes: plan, execute in the rehearsal, diagnose from the log, plan better with the new twin."""

import itertools
import json
import os
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from egophys_msgs.action import DiagnoseTwin, ExecutePlan, PlanToTarget
from egophys_msgs.srv import RolloutTwin
from egophys_ros_common.conversions import points_message
from lifecycle_msgs.msg import Transition
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from egophys_core.evaluation import two_way_chamfer
from egophys_core.identification import FitOptions, build
from egophys_core.planning import final_shapes, grasp_from_points, rollout_plans
from egophys_core.recording import xyz_of_message
from egophys_core.rehearsal import Motion, RehearsalOptions, rehearse
from egophys_core.twin import save_twin
from egophys_core.waypoint_plan import plan_of_message
from tests.ros.cloth import lifting_plan

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(900)]
pytest.importorskip("mujoco", reason="the rehearsal needs the extra `rehearsal`")

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws/src"
CALIBRATION = SOURCES / "xarm_bridge/config/world_to_base.yaml"
ADDRESSES = (f"127.{1 + os.getpid() // 256 % 100}.{os.getpid() % 256}.{index}" for index in itertools.count(77))
SEEN = {"points": 150, "noise_m": 0.001, "occlusion": False}
BOX = {"high_m": [0.15, 0.3, 0.34]}
"""The arm can reach all of it, which it cannot of the default one."""
PLANNING = {"waypoints": 4, "samples": 8, "iterations": 8, "noise_m": 0.08, "settle_s": 1.5, **BOX}
EFFECT = '{"constant_body_force": {"x": 2.5, "y": 1.5, "z": 0.0}}'
"""m/s^2, a quarter of the object's weight to the side; what lies on the table stays where it is."""
DIAGNOSIS = {
    "diagnosis.baseline_starts": 2,
    "diagnosis.refit_iterations": 3,
    "diagnosis.surrogates": 50,
    "diagnosis.bootstraps": 100,
}


@pytest.fixture(scope="module")
def lab_twin():
    """A twin of the object as it is without the injected effect, from a handling of it."""
    episode = rehearse(RehearsalOptions(**SEEN, duration_s=5.0), Motion.LIFT, seed=1)
    return build([episode], FitOptions(generations=8, population=8, dense_steps=3, max_nodes=150), seed=0)


@pytest.fixture
def lab(start_node, client, lab_twin, tmp_path):
    """All nodes, with an effect injected that the twin does not know; the folder of the log."""
    path = tmp_path / "object.twin"
    save_twin(lab_twin, path)
    address = next(ADDRESSES)
    start_node("xarm_bridge", "emulator", "--host", address).wait_for_output("ready on")

    def start(package, executable, config, **parameters):
        file = str(SOURCES / package / "config" / config)
        values = {"autostart": "true", **parameters}
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        start_node(package, executable, "--ros-args", "--params-file", file, *words)
        client.wait_for_state(f"/{executable}", "active")

    start("egophys_twin", "recorder_node", "recorder.yaml", output_folder=tmp_path / "log")
    start("egophys_twin", "twin_node", "twin.yaml", twin_path=path)
    start("egophys_planner", "mppi_planner_node", "planner.yaml")
    arm = {"robot_ip": address, "allow_emulator": "true", "calibration_file": CALIBRATION}
    start("xarm_bridge", "bridge_node", "bridge.yaml", **arm)
    injected = {"effects": "constant_body_force", "effect_parameters": f"'{EFFECT}'"}
    start("egophys_rehearsal", "rehearsal_node", "rehearsal.yaml", **injected, **SEEN)
    return tmp_path / "log"


def act(client, kind, name, goal, timeout):
    handle = client.send_goal(kind, name, goal)
    assert handle.accepted, name
    ended = client.result(handle, timeout=timeout)
    assert ended.status == GoalStatus.STATUS_SUCCEEDED, ended.result.message
    return ended.result


def plan_and_execute(client, target):
    """Plan to a shape and execute that: the plan, the end that the twin in use predicts, and the measured end."""
    goal = PlanToTarget.Goal(
        target=points_message(target, ids=np.arange(len(target))), options_json=json.dumps(PLANNING)
    )
    plan = act(client, PlanToTarget, "/mppi_planner_node/plan_to_target", goal, 300).plan
    rolled_out = client.call(RolloutTwin, "/twin_node/rollout", RolloutTwin.Request(plans=[plan], return_shapes=True))
    assert rolled_out.success, rolled_out.message
    executed = act(client, ExecutePlan, "/bridge_node/execute", ExecutePlan.Goal(plan=plan), 120).executed
    end = executed.poses[-1].header.stamp

    def is_later(message):
        stamp = message.header.stamp
        return (stamp.sec, stamp.nanosec) >= (end.sec, end.nanosec)

    measured = client.message(PointCloud2, "/object/points", is_later, timeout=180)
    return (
        plan,
        xyz_of_message(rolled_out.final_shapes[0], source="predicted"),
        xyz_of_message(measured, source="measured"),
    )


def wait_for_planner(client, twin_id):
    def has_it(message):
        values = {each.key: each.value for each in message.status[0].values}
        return message.status[0].name == "/mppi_planner_node" and values.get("twin id") == twin_id

    client.message(DiagnosticArray, "/diagnostics", has_it)


def test_the_next_plan_ends_nearer_to_its_prediction(lab, client, lab_twin, tmp_path):
    wait_for_planner(client, lab_twin.twin_id)
    # High enough to hang free: what lies on the table is held by friction, whatever else acts.
    lifted = lifting_plan(grasp_from_points(lab_twin.grasp), 0.34, hold_s=2.0)
    hanging = final_shapes(lab_twin, rollout_plans(lab_twin, [lifted]))[0]
    before = []
    for aside in ((-0.06, 0.04, 0.0), (0.0, 0.12, -0.04)):
        assert client.call(Trigger, "/rehearsal_node/reset", timeout=60).success
        _, predicted, measured = plan_and_execute(client, hanging + np.float32(aside))
        before.append(two_way_chamfer(predicted, measured))

    assert client.change_state("/recorder_node", Transition.TRANSITION_DEACTIVATE)
    goal = DiagnoseTwin.Goal(
        episode_paths=[str(lab)], output_folder=str(tmp_path / "diagnosis"), options_json=json.dumps(DIAGNOSIS)
    )
    found = act(client, DiagnoseTwin, "/twin_node/diagnose", goal, 600)
    assert list(found.episodes) == ["log_execution_1", "log_execution_2"]
    assert found.outcome != "none", found.message
    assert sum(found.track_after_m) < 0.8 * sum(found.track_before_m)
    assert found.info.parent_id == lab_twin.twin_id
    wait_for_planner(client, found.info.twin_id)

    assert client.call(Trigger, "/rehearsal_node/reset", timeout=60).success
    plan, predicted, measured = plan_and_execute(client, hanging + np.float32((0.04, 0.06, 0.0)))
    assert plan.twin_id == found.info.twin_id
    after = two_way_chamfer(predicted, measured)
    unaware = two_way_chamfer(final_shapes(lab_twin, rollout_plans(lab_twin, [plan_of_message(plan)]))[0], measured)
    told = f"{found.outcome} {list(found.effects)}: off by {before} m, then by {after} m, by {unaware} m without"
    assert after < 0.8 * min(before), told
    assert after < 0.8 * unaware, told
