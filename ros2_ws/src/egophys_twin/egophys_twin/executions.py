"""Executed plans in a log -> episodes: the object as it was seen, the hands as the tool moved. Imports no ROS."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from scipy.spatial.transform import Rotation

from egophys_core.episode import WORLD_FRAME, Episode
from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.interpolation import PosesOverTime
from egophys_core.planning import Grasp, grasp_from_points
from egophys_core.recording import (
    CONTROLLER_TOPIC,
    Record,
    decode_episode,
    decode_points,
    encode_points,
    list_topics,
    read_records,
    require_steady_stamps,
    types_of_topics,
)
from egophys_core.waypoint_plan import NANOSECONDS

EXECUTED_TOPIC = "/bridge_node/executed"
"""nav_msgs/Path of each plan that was executed, measured poses of the tool."""

StampedRecord = tuple[int, Record]
"""A message of the object's points: its header's stamp, nanoseconds since the epoch, and how it was recorded."""


@dataclass(frozen=True, kw_only=True)
class MeasuredPath:
    """Where the tool was while a plan was executed. Frame `world`."""

    stamps_ns: np.ndarray
    """[S] int64, nanoseconds since the epoch, increasing."""
    positions: np.ndarray
    """[S, 3] metres."""
    quaternions: np.ndarray
    """[S, 4] x y z w."""

    def points_at(self, stamp_ns: int, grasp: Grasp) -> np.ndarray:
        """[C, 3] metres: the points that move with the tool, at a time within the path."""
        times = (self.stamps_ns - self.stamps_ns[0]) / NANOSECONDS
        time = (stamp_ns - int(self.stamps_ns[0])) / NANOSECONDS
        position, rotation = PosesOverTime(times, self.positions, Rotation.from_quat(self.quaternions)).at(time)
        return np.asarray(rotation.apply(grasp.controllers) + position)

    def until(self, seconds: float) -> "MeasuredPath":
        """The part of its first seconds."""
        part = self.stamps_ns <= self.stamps_ns[:1] + round(seconds * NANOSECONDS)
        return MeasuredPath(
            stamps_ns=self.stamps_ns[part], positions=self.positions[part], quaternions=self.quaternions[part]
        )

    def frames(self, seen: Sequence[StampedRecord]) -> list[StampedRecord]:
        """What was seen meanwhile."""
        if len(self.stamps_ns) < 2:
            return []
        first, last = self.stamps_ns[[0, -1]].tolist()
        return [each for each in seen if first <= each[0] <= last]


def has_executions(path: Path, executed_topic: str = EXECUTED_TOPIC) -> bool:
    """Whether a log says of executed plans.

    Raises:
        RecordingError: not a bag.
    """
    return any(topic.name == executed_topic and topic.messages for topic in list_topics(path))


def execution_episodes(
    path: Path,
    *,
    executed_topic: str = EXECUTED_TOPIC,
    object_topic: str,
    grasp: np.ndarray,
    ground_height: float = 0.0,
) -> list[Episode]:
    """An episode of each plan that was executed while the log was recorded.

    It lasts from the start of the plan until the arm stood still after it. Its controllers are those that a
    rollout of the plan moves, at the measured places of the tool.

    Args:
        path: the log, a rosbag2 folder or an MCAP file.
        executed_topic: nav_msgs/Path of measured tool poses, one message an executed plan.
        object_topic: PointCloud2 topic of the object's points.
        grasp: [C, 3] metres, world, the points that move with the tool when it takes hold (`Twin.grasp`).
        ground_height: z of the table, metres.

    Raises:
        RecordingError: not a log, or a message is not readable.
        EpisodeError: no object points were recorded while a plan was executed, or they form no episode; stamps that
            jump.
        PlanningError: there are no points in `grasp`.
    """
    held = grasp_from_points(grasp)
    paths = [each for each in _measured_paths(path, executed_topic) if len(each.stamps_ns) > 1]
    seen = [
        (decode_points(record.cdr, source=f"{path} {object_topic}").stamp_ns, record)
        for record in read_records(path, (object_topic,))
    ]
    episodes = [
        execution_episode(
            measured,
            frames,
            held,
            name=f"{path.resolve().name}_execution_{number}",
            object_topic=object_topic,
            ground_height=ground_height,
        )
        for number, measured in enumerate(paths, start=1)
        if len(frames := measured.frames(seen)) > 1
    ]
    if not episodes:
        raise EpisodeError(
            f"{path}: no points on {object_topic} while one of {len(paths)} plans was executed; "
            "record that topic, with the observer running"
        )
    return episodes


def execution_episode(
    path: MeasuredPath,
    frames: Sequence[StampedRecord],
    held: Grasp,
    *,
    name: str,
    object_topic: str,
    ground_height: float,
) -> Episode:
    """What was seen while the tool went along a path, and the points that moved with it.

    Args:
        path: of the tool.
        frames: of the object, with stamps within the path.
        held: the points that move with the tool.
        name: of the episode.
        object_topic: of the frames.
        ground_height: z of the table, metres.

    Raises:
        EpisodeError: they form no episode.
    """
    return decode_episode(
        [record for _, record in frames] + [_hand_record(stamp, path.points_at(stamp, held)) for stamp, _ in frames],
        name=name,
        object_topic=object_topic,
        controller_topic=CONTROLLER_TOPIC,
        ground_height=ground_height,
    )


def measured_path(message: Any, *, source: str) -> MeasuredPath:
    """The path in a nav_msgs/Path, a message object of rclpy or of rosbags.

    Args:
        message: of measured poses, stamped with the time of measurement.
        source: where it came from, for error messages.

    Raises:
        EpisodeError: stamps that jump.
    """
    stamps = [each.header.stamp.sec * NANOSECONDS + each.header.stamp.nanosec for each in message.poses]
    require_steady_stamps(stamps, source)
    places = [(each.pose.position, each.pose.orientation) for each in message.poses]
    return MeasuredPath(
        stamps_ns=np.array(stamps, np.int64),
        positions=np.array([[place.x, place.y, place.z] for place, _ in places]),
        quaternions=np.array([[turn.x, turn.y, turn.z, turn.w] for _, turn in places]),
    )


def _hand_record(stamp_ns: int, points: np.ndarray) -> Record:
    """The tool's points as they would have been recorded."""
    count = len(points)
    return Record(
        topic=CONTROLLER_TOPIC,
        type="sensor_msgs/msg/PointCloud2",
        log_time_ns=stamp_ns,
        cdr=encode_points(
            stamp_ns=stamp_ns,
            frame_id=WORLD_FRAME,
            xyz=points,
            ids=np.arange(count, dtype=np.uint32),
            confidence=np.ones(count, np.float32),
        ),
    )


def _measured_paths(path: Path, topic: str) -> list[MeasuredPath]:
    types = types_of_topics([each for each in list_topics(path) if each.name == topic])
    found: list[MeasuredPath] = []
    for record in read_records(path, (topic,)):
        try:
            message: Any = types.deserialize_cdr(record.cdr, record.type)
        except SerdeError as error:
            raise RecordingError(f"{path}: a message on {topic} is not readable: {error}") from error
        found.append(measured_path(message, source=f"{path} {topic}, plan {len(found) + 1}"))
    return found
