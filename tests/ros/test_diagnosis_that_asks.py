"""A diagnosis that asks for a motion, over the real nodes: the emulated arm does it with the rehearsed object."""

import itertools
import json
import os
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from egophys_msgs.action import DiagnoseTwin
from egophys_ros_common.qos import latched
from nav_msgs.msg import Path as PathMessage

from egophys_core.effects import LIBRARY
from egophys_core.identification import FitOptions, build
from egophys_core.recording import read_episode, write_episode
from egophys_core.rehearsal import Motion, RehearsalOptions, rehearse
from egophys_core.twin import save_twin

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(600)]
pytest.importorskip("mujoco", reason="the rehearsal needs the extra `rehearsal`")

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws/src"
CALIBRATION = SOURCES / "xarm_bridge/config/world_to_base.yaml"
ADDRESSES = (f"127.{1 + os.getpid() // 256 % 100}.{os.getpid() % 256}.{index}" for index in itertools.count(177))
SEEN = {"points": 150, "noise_m": 0.001, "occlusion": False}
SMALL = {
    "diagnosis.baseline_starts": 1,
    "diagnosis.refit_iterations": 1,
    "diagnosis.shortlist": 1,
    "diagnosis.surrogates": 20,
    "diagnosis.bootstraps": 50,
}
WITHOUT = sorted(LIBRARY.keys() - {"quadratic_drag"})
"""Effects that would only take time."""


@pytest.fixture
def lab(start_node, client, tmp_path):
    """All nodes that it takes, a twin of the object in use, and a recording of the object."""
    episode = rehearse(RehearsalOptions(**SEEN, duration_s=3.0), Motion.LIFT, seed=1)
    write_episode(episode, tmp_path / "lift")
    twin = build([episode], FitOptions(generations=2, population=4, dense_steps=1, max_nodes=80), seed=0)
    save_twin(twin, tmp_path / "object.twin")
    address = next(ADDRESSES)
    start_node("xarm_bridge", "emulator", "--host", address).wait_for_output("ready on")
    for package, executable, config, parameters in (
        ("egophys_twin", "twin_node", "twin.yaml", {"twin_path": tmp_path / "object.twin"}),
        (
            "xarm_bridge",
            "bridge_node",
            "bridge.yaml",
            {"robot_ip": address, "allow_emulator": "true", "calibration_file": CALIBRATION},
        ),
        ("egophys_rehearsal", "rehearsal_node", "rehearsal.yaml", SEEN),
    ):
        file = str(SOURCES / package / "config" / config)
        values = {"autostart": "true", **parameters}
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        start_node(package, executable, "--ros-args", "--params-file", file, *words)
        client.wait_for_state(f"/{executable}", "active")
    return tmp_path


def test_the_arm_does_a_motion_that_a_diagnosis_asks_for(lab, client):
    goal = DiagnoseTwin.Goal(
        episode_paths=[str(lab / "lift")],
        output_folder=str(lab / "found"),
        options_json=json.dumps(SMALL),
        without=WITHOUT,
        ask=1,
    )
    in_the_way = lab / "found_asked"
    (in_the_way / "motion_1").mkdir(parents=True)
    refused = client.act(DiagnoseTwin, "/twin_node/diagnose", goal).result
    assert "found_asked: the folder is not empty" in refused.message
    (in_the_way / "motion_1").rmdir()

    stages = []
    handle = client.send_goal(DiagnoseTwin, "/twin_node/diagnose", goal, stages.append)
    ended = client.result(handle, timeout=500)
    result = ended.result
    assert ended.status == GoalStatus.STATUS_SUCCEEDED, result.message
    (sentence,) = result.asked
    assert sentence.startswith("hold one corner; ")
    assert "motions asked for: 1" in result.message
    assert list(result.episodes) == ["asked_motion_1", "lift"]
    assert {f"motion 1: {sentence}", "wait until the object is at rest"} <= {each.stage for each in stages}
    shares = [each.progress for each in stages]
    assert shares == sorted(shares)
    assert json.loads((lab / "found/diagnosis.json").read_text())["limits"]

    episode = read_episode(lab / "found_asked/motion_1")
    assert np.ptp(episode.controllers[:, 0], axis=0).max() > 0.05
    assert np.nanmax(episode.points[..., 2]) > 0.05
    executed = client.message(PathMessage, "/bridge_node/executed", qos=latched())
    # The recorded motion ends before the gripper opens, half a second after it, and rises.
    stamps = [executed.poses[index].header.stamp for index in (0, -1)]
    lasted = stamps[1].sec - stamps[0].sec + 1e-9 * (stamps[1].nanosec - stamps[0].nanosec)
    assert 1.4 < lasted - episode.times[-1] < 2.5
