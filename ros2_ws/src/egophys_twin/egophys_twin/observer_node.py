"""observer_node: follows the object and the hand on the live camera and publishes their points."""

import sys
from enum import StrEnum
from functools import partial
from typing import Any

from egophys_ros_common import names
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_names, declare_options, declare_texts, read_option_groups
from egophys_ros_common.qos import latched
from egophys_ros_common.running import run_node
from egophys_ros_common.worker import CanceledError, Worker
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from egophys_core.errors import EgophysError, OptionsError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.video import IMAGE_TOPIC, INFO_TOPIC
from egophys_core.perception.live import require_live
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import PerceptionOptions
from egophys_twin.camera_sight import CameraSight
from egophys_twin.observer_topics import ObserverTopics, overlay_message


class ImageTransport(StrEnum):
    """How the camera sends its images."""

    COMPRESSED = "compressed"
    RAW = "raw"

    @property
    def message(self) -> Any:
        """The type of the messages."""
        return CompressedImage if self is ImageTransport.COMPRESSED else Image


TOPIC_PARAMETERS = {
    "image_topic": (IMAGE_TOPIC, "topic of the camera's images"),
    "camera_info_topic": (INFO_TOPIC, "topic of the camera's calibration"),
    "object_topic": (names.OBJECT_POINTS, "topic to publish the object's points on"),
    "controller_topic": (names.CONTROLLER_POINTS, "topic to publish the hand's points on"),
}
TRANSPORT_PARAMETER = {
    "image_transport": ("compressed", "compressed (sensor_msgs/CompressedImage) or raw (sensor_msgs/Image)"),
}
OPTION_GROUPS = ((PerceptionOptions, "perception."), (Board, "board."))
"""Classes of options and the prefixes of their parameters."""
SILENCE_S = 2.0
"""A camera that has sent nothing for so long is reported."""


class ObserverNode(ManagedNode):
    """Looks at the newest image on a worker thread, again and again; images that come meanwhile are skipped."""

    def __init__(self) -> None:
        """Declare the parameters: topics, options of perception, and the board."""
        super().__init__("observer_node")
        declare_names(self, TOPIC_PARAMETERS)
        declare_texts(self, TRANSPORT_PARAMETER)
        for options, prefix in OPTION_GROUPS:
            declare_options(self, options, prefix)
        self._topics: ObserverTopics
        self._worker: Worker
        self._listening: list[Subscription] = []
        self._forget()

    def configure(self) -> None:
        """Check the parameters and create topics and the service."""
        self._perception, self._board = read_option_groups(self, OPTION_GROUPS)
        require_live(self._perception)
        self._transport = _transport(self.get_parameter("image_transport").value)
        self._worker = self.own(Worker("observe", self.hand_over), Worker.close)
        self._topics = ObserverTopics(
            self, self.get_parameter("object_topic").value, self.get_parameter("controller_topic").value
        )
        self.own(self.create_service(Trigger, "~/reset", self._reset), self.destroy_service)

    def activate(self) -> None:
        """Listen to the camera; the object is learnt from the first images."""
        self._forget()
        info = partial(self.create_subscription, CameraInfo, self.get_parameter("camera_info_topic").value)
        # Cameras publish their calibration with every image, or once for all: no one subscription gets both.
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._listening = [
            info(self._take_info, qos_profile_sensor_data, event_callbacks=quiet),
            info(self._take_info, latched(), event_callbacks=quiet),
            self.create_subscription(
                self._transport.message,
                self._image_topic,
                self._take_image,
                qos_profile_sensor_data,
                callback_group=ReentrantCallbackGroup(),
                raw=True,
            ),
        ]

    def deactivate(self) -> None:
        """Stop listening, and finish the image that is looked at."""
        while self._listening:
            self.destroy_subscription(self._listening.pop())
        self._worker.stop()

    def status(self) -> str:
        """What the observer does, or what it waits for."""
        if not self.is_active:
            return super().status()
        return self._sight.status if self._sight else f"waits for images on {self._image_topic}"

    def opening_line(self) -> str:
        """What the observer waits for."""
        return self.status()

    def fault(self) -> str:
        """What of the camera does not come."""
        if not self.is_active:
            return ""
        if self._seconds_since(self._newest_ns) > SILENCE_S:
            return f"no image on {self._image_topic}{self._what_is_published(self._image_topic)}"
        if self._info is None and self._seconds_since(self._began_ns) > SILENCE_S:
            return f"images, but no camera info on {self.get_parameter('camera_info_topic').value}"
        return self._camera_problem

    def health(self) -> dict[str, str]:
        """Counts of images and points."""
        counts = {"frames received": str(self._received), "frames skipped": str(self._skipped)}
        return counts | (self._sight.details() if self._sight else {})

    def _forget(self) -> None:
        self._info: CameraInfo | None = None
        self._sight: CameraSight | None = None
        self._waiting: tuple[bytes, int] | None = None
        self._is_looking = False
        self._received = self._skipped = 0
        self._newest_ns = self._began_ns = self.get_clock().now().nanoseconds
        self._camera_problem = ""

    @property
    def _image_topic(self) -> str:
        return str(self.get_parameter("image_topic").value)

    def _seconds_since(self, stamp_ns: int) -> float:
        return float(self.get_clock().now().nanoseconds - stamp_ns) * 1e-9

    def _what_is_published(self, topic: str) -> str:
        wanted = "sensor_msgs/msg/" + self._transport.message.__name__
        others = {each.topic_type for each in self.get_publishers_info_by_topic(topic)} - {wanted}
        return f": it is {', '.join(sorted(others))}; set image_transport" if others else ""

    def _take_info(self, message: CameraInfo) -> None:
        self._info = message
        if self._sight is None:
            self._begin()

    def _begin(self) -> None:
        """Learn the object anew, with the camera as it is now."""
        try:
            self._sight = CameraSight(self._info, options=self._perception, board=self._board)
        except EgophysError as error:
            # The next camera info may be a good one; until then one line in the log is enough.
            if str(error) != self._camera_problem:
                self._camera_problem = self.refuse("cannot use the camera info", error)
        else:
            self.last_error = self._camera_problem = ""

    async def _take_image(self, cdr: bytes) -> None:
        now_ns = self.get_clock().now().nanoseconds
        self._received += 1
        self._newest_ns = now_ns
        self._skipped += self._waiting is not None
        self._waiting = cdr, now_ns
        if self._is_looking:
            return
        self._is_looking = True
        try:
            while self.is_active and self._sight is not None and self._waiting is not None:
                newest, self._waiting = self._waiting, None
                await self._look(self._sight, *newest)
        except CanceledError:
            pass
        except Exception as error:
            self.refuse("cannot observe", error)
        finally:
            self._is_looking = False

    async def _look(self, sight: CameraSight, cdr: bytes, received_ns: int) -> None:
        wants_overlay = self._topics.wants_overlay

        def look() -> list[tuple[Observation, bytes | None]]:
            message = deserialize_message(cdr, self._transport.message)
            observations = sight.look(message, received_ns=received_ns)
            return [(each, overlay_message(each, sight.status) if wants_overlay else None) for each in observations]

        for observation, overlay in await self._worker.run(look):
            if self.is_active and sight is self._sight:
                self._topics.publish(observation, sight.is_known(observation), overlay)

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.is_active or self._info is None:
            response.message = (self.fault() or self.status()) if self.is_active else "the node is not active"
            return response
        self._sight = None
        self._begin()
        response.success = self._sight is not None
        response.message = self._sight.status if self._sight else self.last_error
        return response


def _transport(name: str) -> ImageTransport:
    try:
        return ImageTransport(name)
    except ValueError:
        raise OptionsError(f"image_transport must be one of {', '.join(ImageTransport)}, got {name!r}") from None


def main() -> int:
    """Run the node; the exit code."""
    return run_node(ObserverNode)


if __name__ == "__main__":
    sys.exit(main())
