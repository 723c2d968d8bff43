"""Writing a rosbag2 MCAP log from serialized messages, so that a killed recorder leaves a readable bag."""

import os
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.writer import Writer

from egophys_core.errors import RecordingError
from egophys_core.files import write_atomically
from egophys_core.recording.bag_metadata import (
    METADATA_NAME,
    BagTopic,
    TopicQos,
    bag_information,
    embedded_text,
    metadata_text,
    qos_text,
)
from egophys_core.recording.message_definitions import MessageDefinition, standard_definition

_NEVER = 2**62  # chunks are ended here, by `flush`, not by the size the mcap writer counts


class LogWriter:
    """A rosbag2 folder being written: one MCAP file (profile `ros2`, zstd chunks) and `metadata.yaml` (v9).

    Messages are held until a chunk is full or `flush_interval_s` old, then written, synced, and
    `metadata.yaml` is replaced; a process killed at any time loses at most what came since. The age is looked
    at when a message arrives: where topics may fall silent, call `flush` from a timer. Not thread-safe.

    Used as a context manager it is closed also when the block fails: what was recorded until then is kept.
    """

    def __init__(self, folder: Path | str, *, flush_interval_s: float = 1.0, chunk_bytes: int = 1024 * 1024) -> None:
        """Create the folder, with a valid empty bag in it.

        Args:
            folder: must not exist; parents are made.
            flush_interval_s: age at which waiting messages are written.
            chunk_bytes: size at which waiting messages are written.

        Raises:
            RecordingError: the folder exists or cannot be made.
        """
        self.folder = Path(folder)
        self._file = self.folder / f"{self.folder.resolve().name}_0.mcap"
        self._flush_interval_s = flush_interval_s
        self._chunk_bytes = chunk_bytes
        self._topics: dict[str, BagTopic] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._counts: Counter[str] = Counter()
        self._lost: Counter[str] = Counter()
        self._start_ns: int | None = None
        self._end_ns: int | None = None
        self._unsaved = True
        self._waiting_bytes = 0
        self._last_flush = time.monotonic()
        self._closed = False
        try:
            self.folder.mkdir(parents=True)
            self._stream = self._file.open("xb")
            self._writer = Writer(self._stream, chunk_size=_NEVER)
            self._writer.start(profile="ros2", library="egophys")
            # rosbag2 tells how to read the channels' QoS by the version in this record.
            self._embed_metadata()
            self.flush()
        except FileExistsError as error:
            raise RecordingError(
                f"{self.folder}: exists already and is not overwritten; choose another name or move it away"
            ) from error
        except OSError as error:
            raise self._unwritable(error) from error

    def add_topic(
        self,
        name: str,
        type_name: str,
        qos: TopicQos | None = None,
        definition: MessageDefinition | None = None,
    ) -> None:
        """Declare a topic before its first message.

        Args:
            name: full topic name.
            type_name: `sensor_msgs/msg/PointCloud2`.
            qos: what its publishers offer; None for reliable, volatile, depth 10.
            definition: of the type; None looks it up among the standard messages.

        Raises:
            RecordingError: declared before, the log is closed, or the type is not known.
        """
        self._require_open()
        if name in self._topics:
            raise RecordingError(f"{self.folder}: topic {name} was declared before, as {self._topics[name].type}")
        definition = definition or standard_definition(type_name)
        if definition.type != type_name:
            raise RecordingError(f"{name} is {type_name}, but the definition given is of {definition.type}")
        topic = BagTopic(name=name, type=type_name, type_hash=definition.type_hash, qos=qos or TopicQos())
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", definition.text.encode())
        self._channels[name] = self._writer.register_channel(
            name,
            "cdr",
            self._schemas[type_name],
            {"offered_qos_profiles": qos_text(topic.qos), "topic_type_hash": topic.type_hash},
        )
        self._topics[name] = topic
        self._unsaved = True
        self._counts[name] = 0

    def write(self, topic: str, cdr: bytes, log_time_ns: int) -> None:
        """Append a serialized message.

        Args:
            topic: a declared topic.
            cdr: the message with its four bytes of encapsulation, as rclpy serializes it.
            log_time_ns: when it was received, nanoseconds since the epoch.

        Raises:
            RecordingError: topic not declared, message or time not valid, log closed, or the disk refuses.
        """
        self._require_open()
        if topic not in self._channels:
            raise RecordingError(
                f"{self.folder}: topic {topic} is not declared; call add_topic first. Declared: "
                f"{', '.join(self._topics) or 'none'}"
            )
        if len(cdr) < 4:
            raise RecordingError(f"{topic}: a serialized message has at least 4 bytes, got {len(cdr)}")
        if not 0 <= log_time_ns < 2**63:
            raise RecordingError(f"{topic}: log time must be nanoseconds since the epoch, got {log_time_ns}")
        self._writer.add_message(self._channels[topic], log_time_ns, cdr, publish_time=log_time_ns)
        self._counts[topic] += 1
        self._start_ns = log_time_ns if self._start_ns is None else min(self._start_ns, log_time_ns)
        self._end_ns = log_time_ns if self._end_ns is None else max(self._end_ns, log_time_ns)
        self._waiting_bytes += len(cdr)
        self._unsaved = True
        is_old = time.monotonic() - self._last_flush >= self._flush_interval_s
        if is_old or self._waiting_bytes >= self._chunk_bytes:
            self.flush()

    def note_lost(self, topic: str, messages: int) -> None:
        """Say in the log that so many more messages of a topic did not reach the recorder.

        Raises:
            RecordingError: the log is closed.
        """
        self._require_open()
        self._lost[topic] += messages
        self._unsaved = True

    def flush(self) -> None:
        """Write what waits as a chunk, sync it to disk, then bring `metadata.yaml` up to date.

        Does nothing when nothing waits, so a timer may call it.

        Raises:
            RecordingError: the log is closed or the disk refuses.
        """
        self._require_open()
        if not self._unsaved:
            return
        try:
            self._writer.flush()
            os.fsync(self._stream.fileno())
            write_atomically(self.folder / METADATA_NAME, metadata_text(self._information()).encode())
        except OSError as error:
            raise self._unwritable(error) from error
        self._unsaved = False
        self._waiting_bytes = 0
        self._last_flush = time.monotonic()

    def close(self) -> None:
        """Write the rest, the index and the final metadata; closing twice is allowed.

        Raises:
            RecordingError: the disk refuses; what was flushed before stays readable.
        """
        if self._closed:
            return
        try:
            self.flush()
            self._embed_metadata()
            self._writer.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise self._unwritable(error) from error
        finally:
            self._closed = True
            with suppress(OSError):  # the disk refused already; the error above says so
                self._stream.close()

    def __enter__(self) -> Self:
        """Return the writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the log, also after an exception."""
        self.close()

    def _information(self) -> dict[str, object]:
        return bag_information(
            file_name=self._file.name,
            topics=list(self._topics.values()),
            counts=self._counts,
            lost=self._lost,
            start_ns=self._start_ns,
            end_ns=self._end_ns,
        )

    def _embed_metadata(self) -> None:
        self._writer.add_metadata("rosbag2", {"serialized_metadata": embedded_text(self._information())})

    def _require_open(self) -> None:
        if self._closed:
            raise RecordingError(f"{self.folder}: the log is closed")

    def _unwritable(self, error: OSError) -> RecordingError:
        return RecordingError(f"{self.folder}: cannot write the log: {error.strerror or error}; free space or rights?")
