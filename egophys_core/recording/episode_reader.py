"""Recorded points -> Episode."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from egophys_core.episode import WORLD_FRAME, Episode
from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.recording.contact_field import recorded_contact
from egophys_core.recording.point_tracks import (
    LONGEST_FILLED_GAP_S,
    fill_short_gaps,
    order_by_stamp,
    pair_by_stamp,
    stack_by_id,
)
from egophys_core.recording.pointcloud import POINTCLOUD2, PointFrame, decode_points
from egophys_core.recording.reader import read_records
from egophys_core.recording.records import Record

OBJECT_TOPIC = "/object/points"
CONTROLLER_TOPIC = "/controller/points"


def read_episode(
    path: Path | str,
    *,
    object_topic: str = OBJECT_TOPIC,
    controller_topic: str = CONTROLLER_TOPIC,
    frame: str = WORLD_FRAME,
    ground_height: float = 0.0,
) -> Episode:
    """Read a recorded episode; the rules are those of `decode_episode`.

    Args:
        path: an `.mcap` or `.db3` file or a rosbag2 folder.
        object_topic: PointCloud2 topic of the object's points.
        controller_topic: PointCloud2 topic of the points of the hands.
        frame: the frame the points must be in, z up.
        ground_height: z of the table, metres; a bag does not record it.

    Raises:
        RecordingError: not a bag, a topic is missing or is no point cloud.
        EpisodeError: the points do not form an episode.
    """
    path = Path(path)
    return decode_episode(
        read_records(path, (object_topic, controller_topic)),
        name=path.resolve().name,
        object_topic=object_topic,
        controller_topic=controller_topic,
        frame=frame,
        ground_height=ground_height,
    )


def decode_episode(
    records: Iterable[Record],
    *,
    name: str,
    object_topic: str = OBJECT_TOPIC,
    controller_topic: str = CONTROLLER_TOPIC,
    frame: str = WORLD_FRAME,
    ground_height: float = 0.0,
) -> Episode:
    """Make an episode of records already read, for example of a part of a log.

    - Messages up to 1 s late are put in order of their header stamps; of several with one stamp the last recorded
      stays.
    - Object and controller messages are paired by header stamp, nearest, at most half a frame apart; the
      others are dropped. Times count from the first pair.
    - Points are stacked by id. One that is NaN, infinite or of confidence 0 counts as not seen; an id never
      seen is left out.
    - A controller missing for up to 0.5 s is interpolated (held at the ends); one missing longer is dropped.
    - A field `contact` (uint8, 0 or 1) of all controller messages says which controllers hold the object.

    Everything left out or filled in is said in an `EpisodeWarning` with its count, except points not seen.

    Args:
        records: any records; those of other topics are passed over.
        name: the episode's name, for messages and provenance.
        object_topic: PointCloud2 topic of the object's points.
        controller_topic: PointCloud2 topic of the points of the hands.
        frame: the frame the points must be in, z up.
        ground_height: z of the table, metres.

    Raises:
        RecordingError: a message is no point cloud with x, y, z and id, or `contact` is in some only or no flag.
        EpisodeError: no messages, stamps that jump, another frame, no controller left, or what `Episode` refuses
            (fewer than two frames, millimetres, nothing visible at the start).
    """
    frames: dict[str, list[PointFrame]] = {object_topic: [], controller_topic: []}
    for record in records:
        if record.topic in frames:
            frames[record.topic].append(_decode(record, name, frame))
    for topic, messages in frames.items():
        if not messages:
            raise EpisodeError(f"{name}: no messages on {topic}; record it, or name the topic that has the points")

    objects, controllers = pair_by_stamp(
        order_by_stamp(frames[object_topic], f"{name} {object_topic}"),
        order_by_stamp(frames[controller_topic], f"{name} {controller_topic}"),
        name,
    )
    if len(objects) < min(2, len(frames[object_topic])):
        raise EpisodeError(
            f"{name}: only {len(objects)} of {len(frames[object_topic])} messages on {object_topic} have a "
            f"partner on {controller_topic} within half a frame; are both stamped by the same clock?"
        )
    stamps_ns = np.array([message.stamp_ns for message in objects], np.int64)
    times = (stamps_ns - stamps_ns[0]) * 1e-9
    point_ids, points, confidence = stack_by_id(objects, f"{name} {object_topic}")
    label = f"{name} {controller_topic}"
    controller_ids, tracks, _ = stack_by_id(controllers, label)
    controller_ids, tracks = fill_short_gaps(times, controller_ids, tracks, label)
    if len(controller_ids) == 0:
        raise EpisodeError(
            f"{name}: no controller on {controller_topic} is seen throughout (gaps of up to "
            f"{LONGEST_FILLED_GAP_S} s are filled); crop the episode to where the hands are tracked"
        )
    return Episode(
        name=name,
        times=times,
        points=points,
        confidence=confidence,
        point_ids=point_ids,
        controllers=tracks,
        controller_ids=controller_ids,
        contact=recorded_contact(controllers, controller_ids, label),
        ground_height=ground_height,
    )


def _decode(record: Record, name: str, frame: str) -> PointFrame:
    source = f"{name} {record.topic} at log time {record.log_time_ns} ns"
    if record.type != POINTCLOUD2:
        raise RecordingError(f"{name}: {record.topic} is {record.type or 'of no named type'}, needed is {POINTCLOUD2}")
    message = decode_points(record.cdr, source=source)
    if message.frame_id != frame:
        raise EpisodeError(
            f"{source}: the points are in frame {message.frame_id!r}, needed is {frame!r} (z up, metres). "
            f"Transform them, or if {message.frame_id!r} is that frame by another name, record them with frame_id "
            f"{frame!r}"
        )
    return message
