"""twin_node with an object that is seen at a few markers: built with template, density and load, then diagnosed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from egophys_msgs.action import BuildTwin, DiagnoseTwin
from egophys_msgs.msg import BuildJob, TwinInfo
from egophys_msgs.srv import RebuildTwin
from egophys_ros_common.qos import latched
from std_msgs.msg import String

from egophys_core.effects import LIBRARY
from egophys_core.identification import FitOptions, build
from egophys_core.kinds.rod import rod_model
from egophys_core.recording import read_episode, write_episode
from egophys_core.twin import encode_twin, load_twin
from tests.kinds.hanging_cable import curve, moved_by_hand, record_of, rolled_out
from tests.kinds.seen_markers import marker_body
from tests.ros.jobs import wait_for_job
from tests.ros.test_twin_diagnosis import SMALL

pytestmark = pytest.mark.ros

NODE = "/twin_node"
TEMPLATE, DENSITY, LOAD = "box:0.5x0.01x0.01", 1100.0, 0.02
OPTIONS_JSON = json.dumps({"template": TEMPLATE, "density": DENSITY})


@pytest.fixture(scope="module")
def cables(tmp_path_factory):
    """Two recordings of a cable that hangs from a hand, which carries it to a side."""
    folder = tmp_path_factory.mktemp("cables")
    hanging = moved_by_hand(record_of(curve(7, length=0.5), held_first=2, held_last=0, frames=60))
    body = marker_body(hanging, None)
    cable = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=0.5)
    way = (1.0 - np.cos(2.0 * np.pi * 0.9 * hanging.times))[:, None, None]
    for name, side in (("one", [0.0, 0.03, 0.0]), ("two", [0.02, 0.0, 0.03])):
        carried = replace(hanging, name=name, controllers=hanging.controllers + np.float32(way * side))
        write_episode(replace(carried, points=rolled_out(cable, body, carried)), folder / name)
    return [folder / "one", folder / "two"]


def test_a_cable_is_built_with_a_load_and_diagnosed(start_twin_node, client, cables, tmp_path):
    start_twin_node()
    output = tmp_path / "cable.twin"
    asked = BuildTwin.Goal(
        episode_paths=[str(cables[0])], output_path=str(output), options_json=OPTIONS_JSON, loads_n=[LOAD], seed=2
    )
    handle = client.send_goal(BuildTwin, f"{NODE}/build", asked)
    assert handle.accepted
    ended = client.result(handle)
    assert ended.status == GoalStatus.STATUS_SUCCEEDED, ended.result.message
    episode = read_episode(cables[0])
    here = build([episode], FitOptions(template=TEMPLATE, density=DENSITY), loads={episode.name: LOAD}, seed=2)
    assert output.read_bytes() == encode_twin(here)
    assert ended.result.info.object_kind == "rod"
    assert json.loads(ended.result.info.settings_json)["loads"] == {episode.name: LOAD}
    training = json.loads(client.message(String, f"{NODE}/training/build", qos=latched()).data)
    assert training["loads"] == {episode.name: LOAD}
    assert training["options"]["template"] == TEMPLATE

    goal = DiagnoseTwin.Goal(
        episode_paths=[str(each) for each in cables],
        output_folder=str(tmp_path / "found"),
        options_json=json.dumps(SMALL),
        loads_n=[LOAD, 0.0],
        without=sorted(LIBRARY.keys() - {"quadratic_drag"}),
    )
    handle = client.send_goal(DiagnoseTwin, f"{NODE}/diagnose", goal)
    assert handle.accepted
    ended = client.result(handle, timeout=300)
    assert ended.status == GoalStatus.STATUS_SUCCEEDED, ended.result.message
    assert list(ended.result.episodes) == ["one", "two"]
    improved = load_twin(tmp_path / "found/improved.twin")
    assert improved.provenance.parent_id == here.twin_id
    assert client.message(TwinInfo, f"{NODE}/info", qos=latched()).twin_id == improved.twin_id
    # The build before ended in this state, too, and its latched message may come first.
    wait_for_job(client, BuildJob.SUCCEEDED, job_id=handle.goal_id)


def test_loads_that_cannot_be_are_refused_with_the_reason(start_twin_node, client, cables, tmp_path):
    start_twin_node()
    for loads, reason in (
        ([0.1, 0.1], "2 load(s) for 1 recording(s); give one in newtons for each"),
        ([-0.1], "must be newtons, not negative, got -0.1"),
    ):
        request = RebuildTwin.Request(
            episode_paths=[str(cables[0])], output_path=str(tmp_path / "no.twin"), loads_n=loads
        )
        answer = client.call(RebuildTwin, f"{NODE}/rebuild", request)
        assert not answer.accepted
        assert reason in answer.message
