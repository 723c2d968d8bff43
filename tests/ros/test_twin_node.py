"""twin_node as an installed process: build, rebuild, cancel, kill, rollouts, parameters, lifecycle."""

import json
import time

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from egophys_msgs.action import BuildTwin
from egophys_msgs.msg import BuildJob, TwinInfo, WaypointPlan
from egophys_msgs.srv import RebuildTwin, RolloutTwin
from egophys_ros_common.conversions import plan_message, points_message
from egophys_ros_common.processes import wait_until
from egophys_ros_common.qos import latched
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String, UInt8MultiArray
from std_srvs.srv import Trigger

from egophys_core.planning import final_shapes, grasp_from_points, rollout_plans, shape_costs
from egophys_core.recording import read_episode, write_episode, xyz_of_message
from egophys_core.twin import decode_twin, encode_twin
from tests.ros.cloth import ENDLESS_JSON, FRAMES, NAME, OPTIONS_JSON, SEED, lifting_plan
from tests.ros.jobs import wait_for_job

pytestmark = pytest.mark.ros

NODE = "/twin_node"


def goal(bag, output, options=OPTIONS_JSON):
    return BuildTwin.Goal(episode_paths=[str(bag)], output_path=str(output), options_json=options, seed=SEED)


def rebuild(client, bag, output, options=OPTIONS_JSON):
    request = RebuildTwin.Request(
        episode_paths=[str(each) for each in ([bag] if bag else [])],
        output_path=str(output),
        options_json=options,
        seed=SEED,
    )
    return client.call(RebuildTwin, f"{NODE}/rebuild", request)


def roll_out(client, plans, target=None, **fields):
    points = points_message(target, ids=np.arange(len(target))) if target is not None else PointCloud2()
    request = RolloutTwin.Request(plans=[plan_message(plan) for plan in plans], target=points, **fields)
    return client.call(RolloutTwin, f"{NODE}/rollout", request)


def shapes_of(answer):
    return np.stack([xyz_of_message(shape, source="shape") for shape in answer.final_shapes])


class TestWithATwin:
    def test_rollouts_are_those_of_an_in_process_call_bit_for_bit(self, twin_node, client, twin):
        grasp = grasp_from_points(twin.grasp)
        plans = [lifting_plan(grasp, height) for height in (0.03, 0.07, 0.11)]
        shapes = final_shapes(twin, rollout_plans(twin, plans))
        target = shapes[1]
        answer = roll_out(client, plans, target, twin_id=twin.twin_id, return_shapes=True)
        assert answer.success, answer.message
        assert answer.twin_id == twin.twin_id
        np.testing.assert_array_equal(shapes_of(answer), shapes)
        np.testing.assert_array_equal(answer.costs, shape_costs(shapes, target))
        assert answer.costs[1] == 0.0
        assert min(answer.costs[0], answer.costs[2]) > 1e-3

        without = roll_out(client, plans, target)
        assert (len(without.costs), len(without.final_shapes)) == (3, 0)
        alone = roll_out(client, plans[:1], return_shapes=True)
        assert len(alone.costs) == 0
        predicted = client.message(PointCloud2, f"{NODE}/predicted/points", qos=latched())
        np.testing.assert_array_equal(xyz_of_message(predicted, source="predicted"), shapes[0])
        plan = client.message(WaypointPlan, f"{NODE}/predicted/plan", qos=latched())
        assert plan.time_from_start == plan_message(plans[0]).time_from_start

    def test_it_answers_while_it_simulates(self, twin_node, client, twin):
        grasp = grasp_from_points(twin.grasp)
        long = [plan_message(lifting_plan(grasp, 0.05, hold_s=60.0))] * 16
        service = client.node.create_client(RolloutTwin, f"{NODE}/rollout")
        wait_until(service.service_is_ready, 30, "rollout service")
        pending = service.call_async(RolloutTwin.Request(plans=long))
        delays = []
        while not pending.done() and len(delays) < 20:
            start = time.monotonic()
            client.state_of(NODE)
            delays.append(time.monotonic() - start)
        assert len(delays) >= 3
        wait_until(pending.done, 60, "the long rollout")
        assert pending.result().success

    def test_what_cannot_be_built_is_refused_with_the_reason(self, twin_node, client, bag, tmp_path):
        output = tmp_path / "no.twin"
        (whole,) = bag.glob("*.mcap")
        cut, hands, nothing = tmp_path / "cut.mcap", tmp_path / "hands", tmp_path / "nothing"
        nothing.mkdir()
        cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
        write_episode(read_episode(bag), hands, object_topic="/cloth/points")
        for arguments, reason in (
            ((None, output), "no episode given"),
            ((cut, output), "cut inside a record (byte"),
            ((nothing, output), "not a bag, the folder holds no"),
            ((hands, output), "no messages on /object/points; the recording has /cloth/points"),
            ((tmp_path / "absent", output), "absent: no such recording"),
            ((bag, tmp_path / "absent" / "no.twin"), "does not exist; create it first"),
            ((bag, tmp_path), "it is a folder; give a file name"),
            ((bag, output, '{"generation": 3}'), "unknown option 'generation'; did you mean 'generations'?"),
            ((bag, output, '{"generations": 0}'), "generations must be in 1 .. 10000, got 0"),
            ((bag, output, "generations=3"), "options_json is not JSON"),
            ((bag, output, '{"kind": "rope"}'), "kind must be one of auto, sheet, solid, rod, lattice"),
        ):
            answer = rebuild(client, *arguments)
            assert not answer.accepted
            assert reason in answer.message
        ended = client.act(BuildTwin, f"{NODE}/build", goal(tmp_path / "absent", output))
        assert ended.status == GoalStatus.STATUS_ABORTED
        assert "absent: no such recording" in ended.result.message
        told = client.message(DiagnosticArray, "/diagnostics", lambda each: each.status[0].name == NODE)
        assert "build refused" in told.status[0].message

    def test_a_failed_build_says_why(self, twin_node, client, bag, tmp_path):
        elsewhere = tmp_path / "elsewhere"
        write_episode(read_episode(bag), elsewhere, frame="camera")
        handle = client.send_goal(BuildTwin, f"{NODE}/build", goal(elsewhere, tmp_path / "no.twin"))
        ended = client.result(handle)
        assert ended.status == GoalStatus.STATUS_ABORTED
        assert "the points are in frame 'camera'" in ended.result.message
        assert wait_for_job(client, BuildJob.FAILED).message == ended.result.message

    def test_options_are_parameters_with_description_and_range(self, twin_node, client):
        names = ["generations", "step_size", "kind", "object_topic"]
        described = client.call(
            DescribeParameters, f"{NODE}/describe_parameters", DescribeParameters.Request(names=names)
        ).descriptors
        assert all(each.description for each in described)
        assert [each.type for each in described] == [
            ParameterType.PARAMETER_INTEGER,
            ParameterType.PARAMETER_DOUBLE,
            ParameterType.PARAMETER_STRING,
            ParameterType.PARAMETER_STRING,
        ]
        assert described[0].integer_range[0].to_value == 10_000
        assert described[1].floating_point_range[0].from_value == 0.01
        values = [Parameter("generations", value=0), Parameter("kind", value="rope"), Parameter("kind", value="solid")]
        request = SetParameters.Request(parameters=[each.to_parameter_msg() for each in values])
        results = client.call(SetParameters, f"{NODE}/set_parameters", request).results
        assert [each.successful for each in results] == [False, False, True]
        assert "kind must be one of auto, sheet, solid" in results[1].reason


def test_a_build_gives_the_twin_of_an_in_process_build(start_twin_node, client, bag, twin, tmp_path):
    start_twin_node()
    output = tmp_path / "new.twin"
    seen = []
    handle = client.send_goal(BuildTwin, f"{NODE}/build", goal(bag, output), seen.append)
    assert handle.accepted
    ended = client.result(handle)
    assert ended.status == GoalStatus.STATUS_SUCCEEDED, ended.result.message
    assert ended.result.success
    assert output.read_bytes() == encode_twin(twin)
    assert ended.result.info.twin_id == twin.twin_id
    assert ended.result.info.path == str(output)
    assert ended.result.info.episodes == [NAME]
    assert ended.result.info.seed == SEED
    assert json.loads(ended.result.info.settings_json)["generations"] == 3
    assert ended.result.info.train_chamfer_m == twin.provenance.scores["train_chamfer_m"]
    assert {each.stage for each in seen} >= {"search", "evaluate"}
    progress = [each.progress for each in seen]
    assert progress == sorted(progress)

    # All of it reaches who comes late.
    assert client.message(TwinInfo, f"{NODE}/info", qos=latched()) == ended.result.info
    model = bytes(client.message(UInt8MultiArray, f"{NODE}/model", qos=latched()).data)
    assert decode_twin(model, name="model").twin_id == twin.twin_id
    assert wait_for_job(client, BuildJob.SUCCEEDED).job_id == handle.goal_id
    training = json.loads(client.message(String, f"{NODE}/training/build", qos=latched()).data)
    assert training["seed"] == SEED
    expected = {"name": NAME, "frames": FRAMES, "ground_height": 0.0, "held": False, "no_table": False}
    assert training["episodes"] == [expected]
    for name in ("object", "controller"):
        stamps = set()

        def all_arrived(message, stamps=stamps):
            stamps.add((message.header.stamp.sec, message.header.stamp.nanosec))
            return len(stamps) == FRAMES

        client.message(PointCloud2, f"{NODE}/training/{name}_points", all_arrived, latched(FRAMES))


def test_a_canceled_goal_leaves_the_previous_twin(start_twin_node, client, bag, twin, twin_file, tmp_path):
    start_twin_node(twin_file)
    output = tmp_path / "never.twin"
    handle = client.send_goal(BuildTwin, f"{NODE}/build", goal(bag, output, ENDLESS_JSON))
    wait_for_job(client, BuildJob.RUNNING, stage="search")
    client.cancel(handle)
    ended = client.result(handle, timeout=10)
    assert ended.status == GoalStatus.STATUS_CANCELED
    assert "canceled" in ended.result.message
    assert wait_for_job(client, BuildJob.CANCELED).job_id == handle.goal_id
    assert not list(tmp_path.glob("*.twin*")) + list(tmp_path.glob(".*"))
    assert client.message(TwinInfo, f"{NODE}/info", qos=latched()).twin_id == twin.twin_id


def test_a_rebuild_is_answered_at_once_and_is_the_only_one(start_twin_node, client, bag, twin, tmp_path):
    start_twin_node()
    answer = rebuild(client, bag, tmp_path / "a.twin", ENDLESS_JSON)
    assert answer.accepted
    assert wait_for_job(client, BuildJob.RUNNING).job_id == answer.job_id
    second = rebuild(client, bag, tmp_path / "b.twin")
    assert not second.accepted
    assert "a build is running" in second.message
    assert not any(second.job_id.uuid)
    assert "is running" in client.act(BuildTwin, f"{NODE}/build", goal(bag, tmp_path / "b.twin")).result.message
    assert client.call(Trigger, f"{NODE}/cancel").success
    wait_for_job(client, BuildJob.CANCELED)
    assert not client.call(Trigger, f"{NODE}/cancel").success

    third = rebuild(client, bag, tmp_path / "c.twin")
    assert third.accepted
    assert wait_for_job(client, BuildJob.SUCCEEDED).job_id == third.job_id
    assert (tmp_path / "c.twin").read_bytes() == encode_twin(twin)
    assert [each.name for each in tmp_path.glob("*.twin*")] == ["c.twin"]


def test_a_killed_node_leaves_the_previous_twin_and_serves_it_again(
    start_twin_node, client, bag, twin, twin_file, tmp_path
):
    folder = tmp_path / "twins"
    folder.mkdir()
    path = folder / "cloth.twin"
    path.write_bytes(twin_file.read_bytes())
    node = start_twin_node(path)
    assert rebuild(client, bag, path, ENDLESS_JSON).accepted
    wait_for_job(client, BuildJob.RUNNING, stage="search")
    node.kill()
    assert [each.name for each in folder.iterdir()] == ["cloth.twin"]
    assert path.read_bytes() == twin_file.read_bytes()

    start_twin_node(path)
    answer = roll_out(client, [lifting_plan(grasp_from_points(twin.grasp), 0.05)], return_shapes=True)
    assert answer.success
    assert answer.twin_id == twin.twin_id


def test_rollouts_that_cannot_be_are_refused_with_the_reason(start_twin_node, client, bag, twin, tmp_path):
    start_twin_node()
    grasp = grasp_from_points(twin.grasp)
    plan = lifting_plan(grasp, 0.05)
    assert "no twin is in use" in roll_out(client, [plan]).message
    assert rebuild(client, bag, tmp_path / "a.twin").accepted
    wait_for_job(client, BuildJob.SUCCEEDED)
    assert "no plan" in roll_out(client, []).message
    assert f"{twin.twin_id} is" in roll_out(client, [plan], twin_id="0123456789abcdef").message
    far = plan_message(plan)
    far.header.frame_id = "link_base"
    answer = client.call(RolloutTwin, f"{NODE}/rollout", RolloutTwin.Request(plans=[far]))
    assert not answer.success
    assert "'link_base'" in answer.message
    answer = roll_out(client, [plan], np.full((2, 3), np.nan, np.float32))
    assert "finite" in answer.message


def test_lifecycle(start_node, client, bag, twin_file, tmp_path):
    node = start_node("egophys_twin", "twin_node", "--ros-args", "-p", f"twin_path:={tmp_path / 'absent.twin'}")
    client.wait_for_state(NODE, "unconfigured")
    assert not client.change_state(NODE, Transition.TRANSITION_CONFIGURE)
    assert client.state_of(NODE) == "unconfigured"
    assert "absent.twin" in node.output
    assert "Traceback" not in node.output
    assert client.set_parameter(NODE, "twin_path", str(twin_file)).successful
    for _ in range(2):
        assert client.change_state(NODE, Transition.TRANSITION_CONFIGURE)
        assert "not active" in rebuild(client, bag, tmp_path / "a.twin").message
        assert client.change_state(NODE, Transition.TRANSITION_ACTIVATE)
        handle = client.send_goal(BuildTwin, f"{NODE}/build", goal(bag, tmp_path / "a.twin", ENDLESS_JSON))
        assert handle.accepted
        wait_for_job(client, BuildJob.RUNNING, stage="search")
        assert client.change_state(NODE, Transition.TRANSITION_DEACTIVATE)
        assert client.result(handle, timeout=10).status == GoalStatus.STATUS_ABORTED
        assert client.change_state(NODE, Transition.TRANSITION_CLEANUP)
    assert node.interrupt() == 0, node.output


def test_a_parameter_acts_at_once_or_is_refused_while_active(start_twin_node, client, twin, twin_file, tmp_path):
    start_twin_node()
    refused = client.set_parameter(NODE, "twin_path", str(twin_file))
    assert not refused.successful
    assert "deactivate first" in refused.reason
    assert client.set_parameter(NODE, "generations", 7).successful, "it is read for each build"
    assert client.change_state(NODE, Transition.TRANSITION_DEACTIVATE)
    assert client.set_parameter(NODE, "twin_path", str(tmp_path / "absent.twin")).successful
    assert not client.change_state(NODE, Transition.TRANSITION_ACTIVATE)
    assert client.state_of(NODE) == "inactive"
    assert client.set_parameter(NODE, "twin_path", str(twin_file)).successful
    assert client.change_state(NODE, Transition.TRANSITION_ACTIVATE)
    assert client.message(TwinInfo, f"{NODE}/info", qos=latched()).twin_id == twin.twin_id


def test_ctrl_c_ends_a_build_in_good_order(start_twin_node, client, bag, tmp_path):
    node = start_twin_node()
    handle = client.send_goal(BuildTwin, f"{NODE}/build", goal(bag, tmp_path / "a.twin", ENDLESS_JSON))
    ended = handle.get_result_async()
    wait_for_job(client, BuildJob.RUNNING, stage="search")
    assert node.interrupt() == 0, node.output
    wait_until(ended.done, 10, "the goal's result, from the node that was told to end")
    assert "canceled" in ended.result().result.message
    assert "Traceback" not in node.output
    assert not list(tmp_path.glob("*.twin*"))


@pytest.mark.parametrize(
    ("parameter", "code", "reason"),
    [
        ("twin_path:=/nowhere/no.twin", 1, "cannot configure: cannot read twin"),
        pytest.param("generations:=0", 2, "parameter generations must be 1 to 10000", marks=pytest.mark.slow),
        pytest.param("kind:=rope", 2, "kind must be one of", marks=pytest.mark.slow),
        ("object_topic:='no name'", 2, "parameter object_topic must be a name, got 'no name'"),
    ],
)
def test_a_node_that_cannot_start_by_itself_ends(start_node, parameter, code, reason):
    node = start_node("egophys_twin", "twin_node", "--ros-args", "-p", "autostart:=true", "-p", parameter)
    assert node.wait_for_end() == code
    assert reason in node.output
    assert "Traceback" not in node.output


def test_help_lists_the_parameters(start_node):
    node = start_node("egophys_twin", "twin_node", "--help")
    assert node.wait_for_end() == 0
    assert "generations (integer, 1 to 10000), default 50" in node.output
