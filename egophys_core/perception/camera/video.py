"""The video in a bag: images one by one in order of time, and the camera that took them."""

import heapq
import struct
import warnings
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rosbags.serde import SerdeError

from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.perception.camera.image_message import COMPRESSED_IMAGE, IMAGE, decode_image
from egophys_core.perception.camera.lens import Camera, camera_from_message, require_size
from egophys_core.recording import TopicInfo, jazzy_types, list_topics, read_records, require_steady_stamps

IMAGE_TOPIC = "/ego/image_raw/compressed"
INFO_TOPIC = "/ego/camera_info"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

REORDERED_FRAMES = 8
"""How many messages are held back to put late ones in their place; later ones are dropped."""

_T = TypeVar("_T")


class VideoWarning(UserWarning):
    """Something of a video was left out, replaced or is missing; says what and how many."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One image of a video."""

    stamp_ns: int
    """Header stamp, nanoseconds since the epoch."""
    image: np.ndarray
    """[H, W, 3] uint8, BGR."""


@dataclass(frozen=True, kw_only=True)
class Video:
    """A video that is read anew, frame by frame, each time it is iterated; made by `open_video`."""

    path: Path
    """The bag."""
    image_topic: str
    """Topic the images are read from."""
    camera: Camera
    """Its intrinsics; images of another size are not yielded."""
    stamps_ns: np.ndarray
    """[T] int64, strictly increasing: the frames `frames()` yields if all of them decode."""
    uses_log_time: bool
    """Whether the stamps are the recorder's, since the headers have none."""

    def __len__(self) -> int:
        """Frames there are, before any fails to decode."""
        return len(self.stamps_ns)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order of their stamps, at most `REORDERED_FRAMES` compressed ones in memory.

        Frames that do not decode, or are of another size than the camera's, are skipped and counted in a
        `VideoWarning` after the last.

        Raises:
            RecordingError: the bag cannot be read any more.
            EpisodeError: no frame decodes.
        """
        broken: list[str] = []
        yielded = 0
        stamped = (
            (record.log_time_ns if self.uses_log_time else _header_stamp(record.cdr), record)
            for record in read_records(self.path, (self.image_topic,))
        )
        for stamp_ns, record in _in_order(stamped, _Dropped()):
            try:
                image = decode_image(record.type, record.cdr, source=f"{self.image_topic} at {stamp_ns} ns")
                if image.shape[:2] != (self.camera.height, self.camera.width):
                    raise RecordingError(f"{image.shape[1]} x {image.shape[0]} pixels, unlike the others")
            except RecordingError as error:
                broken.append(str(error))
                continue
            yielded += 1
            yield Frame(stamp_ns=stamp_ns, image=image)
        if broken and yielded == 0:
            raise EpisodeError(f"{self.path}: none of {len(broken)} images can be read; the first: {broken[0]}")
        if broken:
            _warn(
                f"{self.path}: {len(broken)} of {len(self)} images of {self.image_topic} are skipped, "
                f"the first: {broken[0]}"
            )


def open_video(
    path: Path | str, image_topic: str = IMAGE_TOPIC, info_topic: str = INFO_TOPIC, *, camera: Camera | None = None
) -> Video:
    """Open the video of a bag; it is read through once for stamps and intrinsics, images are not kept.

    - A topic that is not there is replaced by the only one of its kind, if there is one.
    - Images up to `REORDERED_FRAMES` late are put in their place; later ones, and those that repeat the stamp of
      another, are dropped. Where all header stamps are 0 the recorder's times are used.
    - Frames that the rate of the others says are missing are counted, not made up.
    - A CameraInfo that changes: the first counts.

    Each of these is said in a `VideoWarning` with its count. Dark, blurred or empty images are passed on.

    Args:
        path: an `.mcap` or `.db3` file or a rosbag2 folder.
        image_topic: sensor_msgs/CompressedImage or Image.
        info_topic: sensor_msgs/CameraInfo.
        camera: intrinsics to use instead of those in the bag.

    Raises:
        RecordingError: not a bag, or no image topic.
        EpisodeError: no images or no intrinsics, or they do not fit each other; stamps that jump.
    """
    path = Path(path)
    topics = list_topics(path)
    image_topic = _topic_of_type(path, topics, image_topic, (COMPRESSED_IMAGE, IMAGE), "images")
    if camera is None:
        info_topic = _topic_of_type(path, topics, info_topic, (CAMERA_INFO,), "camera intrinsics")
    scan = _scan(path, image_topic, None if camera else info_topic)
    camera = camera or _first_camera(scan, f"{path}: {info_topic}")
    if scan.image is not None:
        require_size(camera, scan.image, source=f"{path}: {image_topic}")
    stamps, uses_log_time = _ordered_stamps(scan, f"{path}: {image_topic}")
    return Video(path=path, image_topic=image_topic, camera=camera, stamps_ns=stamps, uses_log_time=uses_log_time)


def _topic_of_type(path: Path, topics: Iterable[TopicInfo], name: str, types: tuple[str, ...], what: str) -> str:
    fitting = [topic for topic in topics if topic.type in types and topic.messages > 0]
    if name in {topic.name for topic in fitting}:
        return name
    if len(fitting) == 1:
        _warn(f"{path}: no {what} on {name}; taken from {fitting[0].name}, the only topic of {fitting[0].type}")
        return fitting[0].name
    there = ", ".join(f"{topic.name} ({topic.type}, {topic.messages} messages)" for topic in topics)
    advice = (
        "name the one to use" if fitting else "record it, or give the intrinsics" if "camera" in what else "record it"
    )
    raise RecordingError(f"{path}: no {what} on {name}; the bag has {there or 'no topics at all'}; {advice}")


@dataclass
class _Scan:
    """What one pass over a bag finds."""

    header_stamps: list[int] = field(default_factory=list)
    log_stamps: list[int] = field(default_factory=list)
    image: np.ndarray | None = None
    """The first that decodes."""
    infos: list[Any] = field(default_factory=list)
    """The first CameraInfo and those that differ from it."""


def _scan(path: Path, image_topic: str, info_topic: str | None) -> _Scan:
    scan = _Scan()
    topics = (image_topic,) if info_topic is None else (image_topic, info_topic)
    for record in read_records(path, topics):
        if record.topic == image_topic:
            scan.header_stamps.append(_header_stamp(record.cdr))
            scan.log_stamps.append(record.log_time_ns)
            if scan.image is None:
                with suppress(RecordingError):
                    scan.image = decode_image(record.type, record.cdr, source=image_topic)
            continue
        try:
            info: Any = jazzy_types().deserialize_cdr(record.cdr, CAMERA_INFO)
        except SerdeError as error:
            raise RecordingError(f"{path}: {record.topic}: not a readable {CAMERA_INFO}: {error}") from error
        if not scan.infos or _intrinsics(info) != _intrinsics(scan.infos[0]):
            scan.infos.append(info)
    return scan


def _intrinsics(info: Any) -> tuple[Any, ...]:
    return info.width, info.height, info.distortion_model, info.k.tobytes(), info.d.tobytes()


def _first_camera(scan: _Scan, label: str) -> Camera:
    if not scan.infos:
        raise EpisodeError(f"{label}: no message is readable; record it, or give the intrinsics")
    if len(scan.infos) > 1:
        _warn(f"{label}: {len(scan.infos) - 1} messages differ from the first, which is used; was the lens zoomed?")
    return camera_from_message(scan.infos[0], source=label)


def _header_stamp(cdr: bytes) -> int:
    """Header stamp, nanoseconds, of a serialized message that begins with a std_msgs/Header; 0 if it is cut."""
    # The second byte of the encapsulation says the byte order; sec (int32) and nanosec (uint32) follow.
    if len(cdr) < 12:
        return 0
    seconds, nanoseconds = struct.unpack_from("<iI" if cdr[1] & 1 else ">iI", cdr, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


@dataclass
class _Dropped:
    late: int = 0
    repeated: int = 0
    moved: int = 0


def _in_order(items: Iterable[tuple[int, _T]], dropped: _Dropped) -> Iterator[tuple[int, _T]]:
    """Yield (stamp, item) by increasing stamp; counts in `dropped` what came too late or repeats a stamp."""
    waiting: list[tuple[int, int, _T]] = []
    last: int | None = None
    newest: int | None = None

    def oldest() -> Iterator[tuple[int, _T]]:
        nonlocal last
        stamp, _, item = heapq.heappop(waiting)
        if last is not None and stamp <= last:
            dropped.repeated += 1
            return
        last = stamp
        yield stamp, item

    for arrival, (stamp, item) in enumerate(items):
        if last is not None and stamp < last:
            dropped.late += 1
            continue
        dropped.moved += newest is not None and stamp < newest
        newest = stamp if newest is None else max(newest, stamp)
        heapq.heappush(waiting, (stamp, arrival, item))
        if len(waiting) > REORDERED_FRAMES:
            yield from oldest()
    while waiting:
        yield from oldest()


def _ordered_stamps(scan: _Scan, label: str) -> tuple[np.ndarray, bool]:
    """[T] int64 stamps as `Video.frames` yields them, and whether they are the recorder's."""
    uses_log_time = not any(scan.header_stamps)
    stamps = scan.log_stamps if uses_log_time else scan.header_stamps
    if uses_log_time:
        _warn(f"{label}: all {len(stamps)} header stamps are 0; the recorder's times are used instead")
    require_steady_stamps(stamps, label)
    dropped = _Dropped()
    ordered = np.array([stamp for stamp, _ in _in_order(((stamp, None) for stamp in stamps), dropped)], np.int64)
    if dropped.moved:
        _warn(f"{label}: {dropped.moved} of {len(stamps)} images are stamped before their predecessor; sorted by stamp")
    if dropped.late:
        _warn(f"{label}: {dropped.late} of {len(stamps)} images come over {REORDERED_FRAMES} messages late; dropped")
    if dropped.repeated:
        _warn(f"{label}: {dropped.repeated} of {len(stamps)} images repeat a stamp; the first of each is kept")
    _warn_of_gaps(label, ordered)
    return ordered, uses_log_time


def _warn_of_gaps(label: str, stamps: np.ndarray) -> None:
    steps = np.diff(stamps)
    if len(steps) < 2:
        return
    usual = float(np.median(steps))
    gaps = steps[steps > 1.5 * usual]
    if len(gaps):
        missing = int(np.round(gaps / usual - 1).sum())
        _warn(
            f"{label}: about {missing} frames are missing in {len(gaps)} gaps between {len(stamps)} frames, "
            f"the longest of {gaps.max() * 1e-9:.2f} s"
        )


def _warn(message: str) -> None:
    warnings.warn(VideoWarning(message), stacklevel=3)
