"""The topics of the observer node: points of the object and of the hand, and a picture of what is seen."""

import numpy as np
from egophys_ros_common.conversions import points_message, time_message
from egophys_ros_common.managed_node import ManagedNode
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, PointCloud2

from egophys_core.perception.camera.image_encoding import jpeg_message
from egophys_core.perception.observation import Observation
from egophys_core.perception.overlay import draw_picture
from egophys_core.perception.overlay_window import follow

VIEW_FRAME = "ego_camera_view"
"""Frame of the overlays: the square, upright view of the camera."""


class ObserverTopics:
    """Publishers of the observer node, of sensor-data quality."""

    def __init__(self, node: ManagedNode, object_topic: str, controller_topic: str) -> None:
        """Create the publishers; the node destroys them at cleanup."""
        self._node = node
        self._object = self._publisher(PointCloud2, object_topic)
        self._controller = self._publisher(PointCloud2, controller_topic)
        self._overlay = self._publisher(CompressedImage, "~/overlay/compressed")

    @property
    def wants_overlay(self) -> bool:
        """Whether someone looks at the overlay; it is not drawn for nobody."""
        return bool(self._overlay.get_subscription_count())

    def publish(self, observation: Observation, known: np.ndarray, overlay: bytes | None) -> None:
        """Publish points, stamped as the image; their ids are the same in every image.

        Args:
            observation: what was seen.
            known: [N] bool, points of the object to publish.
            overlay: a serialized CompressedImage, if one was drawn.
        """
        stamp = time_message(observation.view.stamp_ns)
        held = np.isfinite(observation.hand_points).all(axis=1)
        points = observation.points[known]
        confidence = observation.confidence[known]
        self._object.publish(points_message(points, ids=np.flatnonzero(known), confidence=confidence, stamp=stamp))
        self._controller.publish(points_message(observation.hand_points[held], ids=np.flatnonzero(held), stamp=stamp))
        if overlay is not None:
            self._overlay.publish(overlay)

    def _publisher(self, kind: type, name: str) -> Publisher:
        publisher = self._node.create_publisher(kind, name, qos_profile_sensor_data)
        return self._node.own(publisher, self._node.destroy_publisher)


def overlay_message(observation: Observation, label: str) -> bytes:
    """The view with what was found in it, and the object magnified beside it: a serialized CompressedImage."""
    picture = draw_picture(observation, window=follow(observation.masks.object), label=label)
    return jpeg_message(picture, stamp_ns=observation.view.stamp_ns, frame_id=VIEW_FRAME)
