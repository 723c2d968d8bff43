"""What is seen of the object while a motion is done, kept as it came and decoded by who needs it. Imports no ROS."""

import time

from egophys_core.episode import WORLD_FRAME
from egophys_core.errors import RecordingError
from egophys_core.recording import PointFrame, Record, decode_points
from egophys_twin.executions import StampedRecord


class ObjectRecording:
    """Messages of one topic; `take` is called on another thread than the rest."""

    def __init__(self, topic: str) -> None:
        """Nothing has come yet on the topic of that full name."""
        self.topic = topic
        self._arrived: list[Record] = []
        self._frames: list[PointFrame] = []
        self._newest_s = time.monotonic()

    def take(self, cdr: bytes) -> None:
        """Keep a serialized PointCloud2."""
        self._newest_s = time.monotonic()
        self._arrived.append(
            Record(topic=self.topic, type="sensor_msgs/msg/PointCloud2", log_time_ns=time.time_ns(), cdr=cdr)
        )

    def silent_s(self) -> float:
        """Seconds since something came."""
        return time.monotonic() - self._newest_s

    def newest_ns(self) -> int:
        """Newest stamp, nanoseconds since the epoch; 0 where nothing has come.

        Raises:
            RecordingError: as `frames`.
        """
        return max((frame.stamp_ns for frame in self._decoded()), default=0)

    def frames(self, since_ns: int) -> list[PointFrame]:
        """What is stamped from a time on, in order of the stamps.

        Raises:
            RecordingError: a message is no tracked points, or they are in another frame than the world.
        """
        return sorted(
            (frame for frame in self._decoded() if frame.stamp_ns >= since_ns), key=lambda frame: frame.stamp_ns
        )

    def records(self) -> list[StampedRecord]:
        """Everything, with its stamps.

        Raises:
            RecordingError: as `frames`.
        """
        frames = self._decoded()
        return [(frame.stamp_ns, record) for frame, record in zip(frames, self._arrived, strict=False)]

    def _decoded(self) -> list[PointFrame]:
        for record in self._arrived[len(self._frames) :]:
            frame = decode_points(record.cdr, source=self.topic)
            if frame.frame_id != WORLD_FRAME:
                raise RecordingError(f"{self.topic} is in frame {frame.frame_id!r}, needed is {WORLD_FRAME!r}")
            self._frames.append(frame)
        return self._frames
