"""observer_node as an installed process: a camera plays, points come; what a camera may do wrong is survived."""

import itertools
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from egophys_ros_common.conversions import time_message
from egophys_ros_common.processes import wait_until
from egophys_ros_common.qos import latched
from lifecycle_msgs.msg import Transition
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from std_srvs.srv import Trigger

from egophys_core.perception.camera.image_message import image_of_message
from egophys_core.recording import points_of_message, read_episode, read_records

pytestmark = pytest.mark.ros

NODE = "/observer_node"
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
VIDEO, MEASURED = EXAMPLES / "towel_lift_video.mcap", EXAMPLES / "towel_lift_video_points.mcap"
IMAGES, INFO = "/ego/image_raw/compressed", "/ego/camera_info"
STILL_FRAMES = 20
"""Of the video, before a hand comes."""
CHEAP = {"perception.side": 300, "perception.queries": 300, "perception.spacing": 8.0}
"""A coarse view, so that a second of it is learnt in seconds."""
FIRST_POINTS_TIMEOUT = 120.0


@pytest.fixture(scope="module")
def video():
    """The first frames (messages) and the camera info of the example."""
    images = [deserialize_message(each.cdr, CompressedImage) for each in read_records(VIDEO, [IMAGES])]
    info = deserialize_message(next(iter(read_records(VIDEO, [INFO]))).cdr, CameraInfo)
    return images[:STILL_FRAMES], info


@pytest.fixture
def observe(start_node, client):
    """`observe(**parameters)` starts an observer and waits until it is active."""

    def start(**parameters):
        values = {"autostart": "true", **CHEAP, **parameters}
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        node = start_node("egophys_twin", "observer_node", "--ros-args", *words)
        client.wait_for_state(NODE, "active")
        return node

    return start


class PublishedCamera:
    """Publishes the still frames forth and back, ten a second, stamped now, until it is stopped."""

    def __init__(self, client, images, info):
        self._node = client.node
        self._images = client.node.create_publisher(type(images[0]), IMAGES, qos_profile_sensor_data)
        self._infos = client.node.create_publisher(CameraInfo, INFO, latched())
        self._infos.publish(info)
        self._frames = itertools.cycle([*images, *images[-2:0:-1]])
        self.stamps = set()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._play)

    def __enter__(self):
        wait_until(self._images.get_subscription_count, 20, "the observer's subscription")
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        for publisher in (self._images, self._infos):
            self._node.destroy_publisher(publisher)

    def _play(self):
        while not self._ended.wait(0.1):
            self.send(next(self._frames))

    def send(self, message):
        nanoseconds = self._node.get_clock().now().nanoseconds
        message.header.stamp = time_message(nanoseconds)
        self.stamps.add(nanoseconds)
        self._images.publish(message)


def wait_for_status(client, condition, timeout=30.0):
    """The first of the observer's diagnostics that meets a condition: its level, message and values."""

    def reached(array):
        return any(each.name == NODE and condition(each, values_of(each)) for each in array.status)

    return client.message(DiagnosticArray, "/diagnostics", reached, timeout=timeout).status[0]


def values_of(status):
    return {each.key: each.value for each in status.values}


def test_points_come_with_the_stamps_of_the_images_and_ids_that_last(observe, client, video):
    images, info = video
    observe()
    with PublishedCamera(client, images, info) as camera:
        messages = client.messages(PointCloud2, "/object/points", 3, timeout=FIRST_POINTS_TIMEOUT)
        black = cv2.imencode(".jpg", np.zeros((info.height, info.width, 3), np.uint8))[1].tobytes()
        cut = bytes(images[0].data)[:2000]
        small = cv2.imencode(".jpg", np.full((90, 120, 3), 128, np.uint8))[1].tobytes()
        for data in (black, cut, small, b""):
            camera.send(CompressedImage(format="jpeg", data=data))
        # Of frames that come faster than they are looked at only the newest counts: send until one is met.
        wait_until(
            lambda: (
                camera.send(CompressedImage(format="jpeg", data=cut))
                or int(values_of(wait_for_status(client, lambda *_: True))["frames not readable"])
            ),
            60,
            "the count of unreadable frames",
        )
        after_ns = client.node.get_clock().now().nanoseconds
        messages += client.messages(PointCloud2, "/object/points", 2, lambda each: stamp_of(each) > after_ns)
        hand = client.message(PointCloud2, "/controller/points")
        overlay = client.message(CompressedImage, f"{NODE}/overlay/compressed", timeout=60)
        status = wait_for_status(client, lambda each, _: each.message.startswith("tracking"))

    assert {each.header.frame_id for each in (*messages, hand)} == {"world"}
    stamps = [stamp_of(each) for each in messages]
    assert stamps == sorted(stamps)
    assert camera.stamps.issuperset(stamps)
    frames = [points_of_message(each, source="points") for each in messages]
    for earlier, later in itertools.pairwise(frames):
        _, before, after = np.intersect1d(earlier.ids, later.ids, return_indices=True)
        assert len(before) > 50
        moved = np.linalg.norm(later.xyz[after] - earlier.xyz[before], axis=1)
        assert np.median(moved) < 0.003, "the towel lies still"
    measured = np.nanmedian(read_episode(MEASURED).points[:STILL_FRAMES], axis=0)
    for frame in frames:
        apart = np.linalg.norm(frame.xyz[:, None] - measured[None], axis=2).min(axis=1)
        assert np.median(apart) < 0.01
    assert image_of_message(overlay, source="overlay").size > 0
    assert status.level == DiagnosticStatus.OK
    counts = values_of(status)
    assert int(counts["frames skipped"]) + int(counts["frames observed"]) < int(counts["frames received"])


def stamp_of(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.mark.slow
def test_reset_learns_the_object_anew(observe, client, video):
    observe()
    assert not client.call(Trigger, f"{NODE}/reset").success, "nothing is known of the camera yet"
    with PublishedCamera(client, *video):
        client.message(PointCloud2, "/object/points", timeout=FIRST_POINTS_TIMEOUT)
        answer = client.call(Trigger, f"{NODE}/reset")
        assert answer.success, answer.message
        wait_for_status(client, lambda each, _: each.message.startswith("learning"))
        asked_ns = client.node.get_clock().now().nanoseconds
        client.message(
            PointCloud2, "/object/points", lambda each: stamp_of(each) > asked_ns, timeout=FIRST_POINTS_TIMEOUT
        )


def test_raw_images_are_seen_too(observe, client, video):
    images, info = video
    raw = []
    for each in images:
        image = image_of_message(each, source="example")
        height, width = image.shape[:2]
        raw.append(Image(height=height, width=width, step=3 * width, encoding="bgr8", data=image.tobytes()))
    observe(image_transport="raw")
    with PublishedCamera(client, raw, info):
        wait_for_status(client, lambda each, _: each.message.startswith(("learning", "tracking")))


def test_it_says_what_is_missing(observe, client):
    observe(image_transport="raw")
    status = wait_for_status(client, lambda each, _: "no image" in each.message)
    assert IMAGES in status.message
    assert status.level == DiagnosticStatus.ERROR
    publisher = client.node.create_publisher(CompressedImage, IMAGES, qos_profile_sensor_data)
    wait_for_status(client, lambda each, _: "sensor_msgs/msg/CompressedImage; set image_transport" in each.message)
    client.node.destroy_publisher(publisher)


def test_another_board_is_not_found_and_a_camera_without_calibration_is_refused(observe, client, video):
    images, info = video
    observe(**{"board.first_id": 100})
    uncalibrated = CameraInfo(height=info.height, width=info.width, distortion_model="plumb_bob")
    with PublishedCamera(client, images, uncalibrated):
        status = wait_for_status(client, lambda each, _: "calibrate the camera" in each.message)
        assert status.level == DiagnosticStatus.ERROR
        # A good one that comes later is taken.
        publisher = client.node.create_publisher(CameraInfo, INFO, 10)
        wait_until(publisher.get_subscription_count, 20, "the observer's subscription")
        # A message on a connection just made may be lost: say it again until it is heard.
        timer = client.node.create_timer(0.5, lambda: publisher.publish(info))
        status = wait_for_status(client, lambda each, _: each.message.startswith("no camera pose"))
        assert status.level == DiagnosticStatus.OK
        client.node.destroy_timer(timer)
        client.node.destroy_publisher(publisher)


def test_lifecycle(start_node, client, video):
    parameters = ("-p", "perception.nearest_m:=0.3", "-p", "image_transport:=theora")
    node = start_node("egophys_twin", "observer_node", "--ros-args", *parameters)
    client.wait_for_state(NODE, "unconfigured")
    assert not client.change_state(NODE, Transition.TRANSITION_CONFIGURE)
    assert client.set_parameter(NODE, "image_transport", "compressed").successful
    for _ in range(2):
        client.start(NODE)
        with PublishedCamera(client, *video):
            wait_for_status(client, lambda each, _: each.message.startswith("learning"))
            assert client.change_state(NODE, Transition.TRANSITION_DEACTIVATE)
        assert not client.call(Trigger, f"{NODE}/reset").success
        assert client.change_state(NODE, Transition.TRANSITION_CLEANUP)
    assert node.interrupt() == 0, node.output
    assert "Traceback" not in node.output


@pytest.mark.parametrize(
    ("parameter", "code", "reason"),
    [
        ("image_transport:=theora", 1, "image_transport must be one of"),
        ("board.rows:=1", 2, "at least 2 columns"),
        ("perception.stages:=learned", 2, "stages learned needs weights"),
        ("perception.weights:=models -p perception.stages:=learned", 1, "go through a video several times"),
    ],
)
def test_what_cannot_work_is_refused(start_node, parameter, code, reason):
    node = start_node("egophys_twin", "observer_node", "--ros-args", "-p", "autostart:=true", "-p", *parameter.split())
    assert node.wait_for_end() == code
    assert reason in node.output
    assert "Traceback" not in node.output
