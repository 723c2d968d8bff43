"""rehearsal_node as an installed process: scripted hands, an arm's tool, reset, what it refuses."""

import os
import threading
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from egophys_ros_common.conversions import world_header
from egophys_ros_common.processes import wait_until
from egophys_ros_common.qos import latched
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from lifecycle_msgs.msg import Transition
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from egophys_core.recording import points_of_message
from egophys_core.rehearsal import RehearsalOptions
from egophys_core.rehearsal.bodies import make_body

pytestmark = pytest.mark.ros
pytest.importorskip("mujoco", reason="the rehearsal needs the extra `rehearsal`")

NODE = "/rehearsal_node"
OBJECT, CONTROLLER = "/object/points", "/controller/points"
POSE_PERIOD_S = 0.02
SPEED = 0.2
"""m/s of the tool."""
BODY = make_body(RehearsalOptions(object="ellipsoid"), 0)
TOP = np.array([0.0, 0.0, BODY.vertices[:, 2].max()])
LIFT = np.array([0.0, 0.0, 0.12])


def start_rehearsal(start_node, **parameters):
    values = {"autostart": "true", "object": "ellipsoid", "points": 60, "noise_m": 0.0, "dropout": 0.0, **parameters}
    words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    return start_node("egophys_rehearsal", "rehearsal_node", "--ros-args", *words)


class Lab:
    """A tool that streams where it is, and what is seen of the object."""

    def __init__(self, node, place):
        self._node = node
        self._place = np.asarray(place, float)
        self._target = self._place
        self._poses = node.create_publisher(PoseStamped, "/bridge_node/tool_pose", qos_profile_sensor_data)
        self._openings = node.create_publisher(Float64, "/bridge_node/gripper_command", latched())
        self.seen = {OBJECT: [], CONTROLLER: []}
        self._subscriptions = [
            node.create_subscription(PointCloud2, topic, messages.append, qos_profile_sensor_data)
            for topic, messages in self.seen.items()
        ]
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._stream, daemon=True)
        self._thread.start()

    def close(self):
        self._ending.set()
        self._thread.join()
        for each in self._subscriptions:
            self._node.destroy_subscription(each)
        for each in (self._poses, self._openings):
            self._node.destroy_publisher(each)

    def grip(self, opening):
        self._openings.publish(Float64(data=opening))

    def go(self, place):
        """Move there."""
        self._target = np.asarray(place, float)
        wait_until(lambda: np.array_equal(self._place, self._target), 20, "the tool's arrival")

    def look(self, topic=OBJECT):
        """What is seen from now on, however late it comes."""
        now = self._node.get_clock().now().nanoseconds
        return wait_until(lambda: next((each for each in self._recent(topic) if each.stamp_ns >= now), None), 60, topic)

    def _recent(self, topic):
        return [points_of_message(each, source=topic) for each in self.seen[topic][-5:]]

    def _stream(self):
        while not self._ending.is_set():
            way = self._target - self._place
            length = np.linalg.norm(way)
            step = SPEED * POSE_PERIOD_S
            self._place = self._target if length <= step else self._place + way * (step / length)
            x, y, z = self._place.tolist()
            pose = Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=1.0, y=0.0, z=0.0, w=0.0))
            stamp = self._node.get_clock().now().to_msg()
            self._poses.publish(PoseStamped(header=world_header(stamp), pose=pose))
            time.sleep(POSE_PERIOD_S)


@pytest.fixture
def lab(client):
    made = Lab(client.node, TOP + LIFT)
    yield made
    made.close()


def test_the_object_goes_with_the_closed_gripper_and_falls_from_the_open_one(start_node, client, lab):
    start_rehearsal(start_node)
    client.wait_for_state(NODE, "active")
    assert "deactivate first" in client.set_parameter(NODE, "points", 70).reason
    lying = lab.look()
    assert len(lying.ids) > 20
    assert set(np.unique(lying.confidence)) == {np.float32(0.9)}
    lab.go(TOP)
    lab.grip(0.0)
    time.sleep(0.3)
    lab.go(TOP + LIFT)
    lifted = lab.look()
    assert lifted.xyz[:, 2].max() > lying.xyz[:, 2].max() + 0.08
    hand = lab.look(CONTROLLER)
    np.testing.assert_allclose(hand.xyz.mean(axis=0), TOP + LIFT, atol=1e-3)
    assert len(hand.ids) == 30
    lab.grip(0.08)
    wait_until(lambda: lab.look().xyz[:, 2].max() < lying.xyz[:, 2].max() + 0.03, 60, "the fall")

    # Begun anew the object lies where it lay, and the gripper is open.
    lab.grip(0.0)
    assert client.call(Trigger, f"{NODE}/reset", timeout=60).success
    lab.go(TOP)
    again = lab.look()
    common, here, there = np.intersect1d(lying.ids, again.ids, return_indices=True)
    assert len(common) > 10
    np.testing.assert_allclose(again.xyz[there], lying.xyz[here], atol=2e-3)


def test_an_object_at_rest_is_looked_at_now_and_then(start_node, client, lab):
    start_rehearsal(start_node)
    lab.look()
    time.sleep(4.0)
    before = len(lab.seen[OBJECT])
    time.sleep(2.0)
    assert 2 <= len(lab.seen[OBJECT]) - before <= 8


def test_scripted_hands_show_an_episode_in_its_own_time(start_node, client, lab):
    given = {"hands": "jump", "duration_s": 2.0, "effects": "control_delay", "effect_size": "small"}
    node = start_rehearsal(start_node, autostart="false", **given)
    client.wait_for_state(NODE, "unconfigured")
    assert not client.change_state(NODE, Transition.TRANSITION_CONFIGURE)
    assert "hands must be one of arm, lift" in node.output
    assert client.set_parameter(NODE, "hands", "lift").successful
    client.start(NODE)

    def told(message):
        status = message.status[0]
        return status.name == NODE and status.message == "60 of 60 frames shown; call ~/reset to begin anew"

    client.message(DiagnosticArray, "/diagnostics", told, timeout=60)
    # On a busy machine all may be gone before the subscription was known; now it is.
    lab.seen[OBJECT].clear()
    assert client.call(Trigger, f"{NODE}/reset", timeout=60).success
    wait_until(lambda: len(lab.seen[OBJECT]) > 50, 60, "the episode, begun anew")
    frames = [points_of_message(each, source=OBJECT) for each in lab.seen[OBJECT]]
    steps = np.diff([each.stamp_ns for each in frames])
    assert (steps > 0).all()
    assert np.median(steps) == pytest.approx(1e9 / 30, rel=0.01)
    assert frames[-1].xyz[:, 2].max() > frames[0].xyz[:, 2].max() + 0.02


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"effects": "control_dela"}, "unknown effect 'control_dela'; did you mean 'control_delay'?"),
        pytest.param(
            {"effects": "control_delay", "effect_size": "huge"},
            "effect_size must be one of small, large, got 'huge'",
            marks=pytest.mark.slow,
        ),
        pytest.param({"object": "rope"}, "object must be one of sheet, ellipsoid, box", marks=pytest.mark.slow),
        ({"effect_parameters": '\'{"control_delay": {"delay": 1}}\''}, "'control_delay', which is not in effects"),
    ],
)
def test_what_cannot_be_rehearsed_is_refused_with_the_reason(start_node, parameters, reason):
    node = start_rehearsal(start_node, **parameters)
    assert node.wait_for_end() == (2 if "object" in parameters else 1)
    assert reason in node.output
    assert "Traceback" not in node.output


def test_without_mujoco_it_says_what_to_install(start_node, tmp_path, monkeypatch):
    (tmp_path / "mujoco.py").write_text("raise ImportError")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ['PYTHONPATH']}")
    node = start_rehearsal(start_node)
    assert node.wait_for_end() == 1
    assert "cannot configure: rehearsing needs the package mujoco" in node.output
    assert "Traceback" not in node.output
