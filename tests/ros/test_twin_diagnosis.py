"""twin_node diagnoses: from the action and from the service, in use afterwards, canceled, refused."""

import json

import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from egophys_msgs import action, srv
from egophys_msgs.msg import BuildJob, TwinInfo
from egophys_ros_common.qos import latched
from std_msgs.msg import UInt8MultiArray

from egophys_core.diagnosis.diagnosis import Outcome
from egophys_core.effects import LIBRARY
from egophys_core.twin import decode_twin, load_twin
from tests.ros.cloth import NAME, OPTIONS_JSON, SEED
from tests.ros.jobs import wait_for_job

pytestmark = pytest.mark.ros

NODE = "/twin_node"
SMALL = {
    "diagnosis.baseline_starts": 2,
    "diagnosis.refit_iterations": 1,
    "diagnosis.shortlist": 1,
    "diagnosis.surrogates": 20,
    "diagnosis.bootstraps": 50,
}
WITHOUT = sorted(LIBRARY.keys() - {"quadratic_drag", "constant_body_force"})
"""Effects that would only take time."""

LONG = {"diagnosis.refit_iterations": 50, "diagnosis.shortlist": 24}


def asked(bag, output, options=SMALL, **fields):
    """What goal and request of the service have in common."""
    return {
        "episode_paths": [str(bag)] if bag else [],
        "output_folder": str(output),
        "options_json": options if isinstance(options, str) else json.dumps(options),
        "seed": SEED,
        "without": WITHOUT,
        **fields,
    }


def start_diagnosis(client, *arguments, **fields):
    request = srv.DiagnoseTwin.Request(**asked(*arguments, **fields))
    return client.call(srv.DiagnoseTwin, f"{NODE}/start_diagnosis", request)


def test_a_diagnosis_puts_the_improved_twin_into_use(start_twin_node, client, bag, twin, twin_file, tmp_path):
    start_twin_node(twin_file)
    seen = []
    goal = action.DiagnoseTwin.Goal(**asked(bag, tmp_path / "found"))
    handle = client.send_goal(action.DiagnoseTwin, f"{NODE}/diagnose", goal, seen.append)
    assert handle.accepted
    ended = client.result(handle)
    result = ended.result
    assert ended.status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert result.success
    assert result.outcome in list(Outcome)
    assert sorted(each.name for each in (tmp_path / "found").iterdir()) == [
        "diagnosis.json",
        "improved.twin",
        "report.html",
    ]
    content = json.loads((tmp_path / "found/diagnosis.json").read_text())
    assert json.loads(result.diagnosis_json) == content
    assert content["outcome"] == result.outcome
    assert list(result.episodes) == [NAME]
    assert list(result.track_after_m) == [each["track_after_m"] for each in content["error"]]
    assert result.info.parent_id == twin.twin_id
    assert result.info.path == str(tmp_path / "found/improved.twin")
    progress = [each.progress for each in seen]
    assert progress == sorted(progress)
    assert len({each.stage for each in seen}) > 2

    assert client.message(TwinInfo, f"{NODE}/info", qos=latched()).twin_id == result.info.twin_id
    assert {each["name"] for each in content["candidates"]}.isdisjoint(WITHOUT)
    model = decode_twin(bytes(client.message(UInt8MultiArray, f"{NODE}/model", qos=latched()).data), name="model")
    assert model.twin_id == result.info.twin_id == load_twin(tmp_path / "found/improved.twin").twin_id
    assert wait_for_job(client, BuildJob.SUCCEEDED).job_id == handle.goal_id


def test_the_service_starts_the_same_job_for_a_twin_that_is_not_in_use(
    start_twin_node, client, bag, twin, twin_file, tmp_path
):
    start_twin_node()
    answer = start_diagnosis(client, bag, tmp_path / "found", twin_path=str(twin_file))
    assert answer.accepted, answer.message
    job = wait_for_job(client, BuildJob.SUCCEEDED)
    assert job.job_id == answer.job_id
    info = client.message(TwinInfo, f"{NODE}/info", qos=latched())
    assert info.parent_id == twin.twin_id
    assert info.twin_id in job.message


def test_one_job_runs_at_a_time_and_a_canceled_diagnosis_leaves_nothing(
    start_twin_node, client, bag, twin, twin_file, tmp_path
):
    start_twin_node(twin_file)
    goal = action.DiagnoseTwin.Goal(**asked(bag, tmp_path / "found", LONG))
    handle = client.send_goal(action.DiagnoseTwin, f"{NODE}/diagnose", goal)
    assert handle.accepted
    assert "a diagnosis is running" in start_diagnosis(client, bag, tmp_path / "other").message
    request = srv.RebuildTwin.Request(
        episode_paths=[str(bag)], output_path=str(tmp_path / "a.twin"), options_json=OPTIONS_JSON
    )
    assert "a diagnosis is running" in client.call(srv.RebuildTwin, f"{NODE}/rebuild", request).message
    client.cancel(handle)
    ended = client.result(handle, timeout=60)
    assert ended.status == GoalStatus.STATUS_CANCELED
    assert "the previous twin stays in use" in ended.result.message
    assert not (tmp_path / "found").exists()
    assert client.message(TwinInfo, f"{NODE}/info", qos=latched()).twin_id == twin.twin_id


def test_what_cannot_be_diagnosed_is_refused_with_the_reason(start_twin_node, client, bag, twin_file, tmp_path):
    start_twin_node()
    output = tmp_path / "found"
    assert "no twin is in use" in start_diagnosis(client, bag, output).message
    full = tmp_path / "full"
    full.mkdir()
    (full / "file").touch()
    for arguments, fields, reason in (
        ((None, output), {}, "no episode given"),
        ((tmp_path / "absent", output), {}, "absent: no such recording"),
        ((bag, full), {}, "the folder is not empty"),
        ((bag, output, '{"diagnosis.shortlst": 3}'), {}, "unknown option 'shortlst'; did you mean 'shortlist'?"),
        ((bag, output, '{"diagnosis.shortlist": 0}'), {}, "shortlist must be in 1 .. 24, got 0"),
        ((bag, output), {"twin_path": str(tmp_path / "absent.twin")}, "absent.twin"),
        ((bag, output), {"ask": 1}, "no bridge serves /bridge_node/execute, so no arm moves"),
    ):
        answer = start_diagnosis(client, *arguments, **({"twin_path": str(twin_file)} | fields))
        assert not answer.accepted
        assert reason in answer.message
    goal = action.DiagnoseTwin.Goal(**asked(bag, full, twin_path=str(twin_file)))
    assert not client.act(action.DiagnoseTwin, f"{NODE}/diagnose", goal).result.success
    told = client.message(DiagnosticArray, "/diagnostics", lambda each: each.status[0].name == NODE)
    assert "diagnosis refused" in told.status[0].message

    # What only the diagnosis itself can know fails it, with the reason.
    answer = start_diagnosis(client, bag, output, twin_path=str(twin_file), without=["drag"])
    assert answer.accepted
    assert "drag" in wait_for_job(client, BuildJob.FAILED).message
    assert not output.exists()
