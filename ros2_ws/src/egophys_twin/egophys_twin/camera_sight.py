"""One camera's images -> observations; what cannot be used is counted, not raised. Imports no ROS."""

from typing import Any

import numpy as np

from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.image_message import image_of_message
from egophys_core.perception.camera.lens import camera_from_message, require_size
from egophys_core.perception.live import LiveObserver
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import PerceptionOptions

SILENCE_S = 0.5
"""Images without points for longer are reported."""


class CameraSight:
    """The live observer of one camera, with what a user wants to know about its images."""

    def __init__(self, camera_info: Any, *, options: PerceptionOptions, board: Board) -> None:
        """Know the camera; the object is learnt from the first images.

        Args:
            camera_info: sensor_msgs/CameraInfo.
            options: of perception.
            board: the printed board on the table.

        Raises:
            EpisodeError: no calibration in the camera info.
        """
        self._options = options
        self._camera = camera_from_message(camera_info, source="camera info")
        self._observer = LiveObserver(self._camera, options=options, board=board)
        self._newest_ns: int | None = None
        self._newest: Observation | None = None
        self._counts = {"observed": 0, "not readable": 0, "out of order": 0}
        self._problem = ""

    @property
    def status(self) -> str:
        """What it does or misses, a sentence."""
        status = self._problem or self._observer.status
        if self._newest is None or self._newest_ns is None:
            return status
        silent_s = (self._newest_ns - self._newest.view.stamp_ns) * 1e-9
        return f"{status}; no points for {silent_s:.1f} s" if silent_s > SILENCE_S else status

    def look(self, message: Any, *, received_ns: int) -> list[Observation]:
        """Observe in one image.

        Args:
            message: sensor_msgs/CompressedImage or Image.
            received_ns: when it came, nanoseconds since the epoch; stands for a stamp of 0.

        Returns:
            In order of their stamps; none while the object is being learnt, and none for an image that cannot be used.
        """
        stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec or received_ns
        if self._newest_ns is not None and stamp_ns <= self._newest_ns:
            self._counts["out of order"] += 1
            self._problem = "images are stamped earlier than before; if a recording was begun anew, call ~/reset"
            return []
        try:
            image = image_of_message(message, source=f"image at {stamp_ns} ns")
            require_size(self._camera, image, source=f"image at {stamp_ns} ns")
        except (RecordingError, EpisodeError) as error:
            self._counts["not readable"] += 1
            self._problem = str(error)
            return []
        self._newest_ns, self._problem = stamp_ns, ""
        observations = self._observer.add(stamp_ns, image)
        self._counts["observed"] += len(observations)
        if observations:
            self._newest = observations[-1]
        return observations

    def details(self) -> dict[str, str]:
        """Counts of images and points, for diagnostics."""
        counts = {f"frames {name}": str(count) for name, count in self._counts.items()}
        if self._newest is None:
            return counts
        return counts | {
            "points": str(len(self._newest.points)),
            "points with a place": str(np.count_nonzero(self.is_known(self._newest))),
            "points seen": str(np.count_nonzero(self._newest.visible)),
        }

    def is_known(self, observation: Observation) -> np.ndarray:
        """[N] bool: points of the object whose place can be trusted."""
        confidence = observation.confidence
        is_sure = (confidence > 0) & (confidence >= self._options.least_confidence)
        return is_sure & np.isfinite(observation.points).all(axis=1)
