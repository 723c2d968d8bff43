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


@dataclass(frozen=True, kw_only=True)
class ToolPath:
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
    tool_paths = [each for each in _tool_paths(path, executed_topic) if len(each.stamps_ns) > 1]
    seen = [
        (decode_points(record.cdr, source=f"{path} {object_topic}").stamp_ns, record)
        for record in read_records(path, (object_topic,))
    ]
    episodes = []
    for number, tool_path in enumerate(tool_paths, start=1):
        first, last = tool_path.stamps_ns[[0, -1]].tolist()
        frames = [(stamp, record) for stamp, record in seen if first <= stamp <= last]
        if len(frames) > 1:
            episodes.append(
                decode_episode(
                    [record for _, record in frames]
                    + [_hand_record(stamp, tool_path.points_at(stamp, held)) for stamp, _ in frames],
                    name=f"{path.resolve().name}_execution_{number}",
                    object_topic=object_topic,
                    controller_topic=CONTROLLER_TOPIC,
                    ground_height=ground_height,
                )
            )
    if not episodes:
        raise EpisodeError(
            f"{path}: no points on {object_topic} while one of {len(tool_paths)} plans was executed; "
            "record that topic, with the observer running"
        )
    return episodes


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


def _tool_paths(path: Path, topic: str) -> Sequence[ToolPath]:
    types = types_of_topics([each for each in list_topics(path) if each.name == topic])
    found: list[ToolPath] = []
    for record in read_records(path, (topic,)):
        try:
            message: Any = types.deserialize_cdr(record.cdr, record.type)
        except SerdeError as error:
            raise RecordingError(f"{path}: a message on {topic} is not readable: {error}") from error
        stamps = [each.header.stamp.sec * NANOSECONDS + each.header.stamp.nanosec for each in message.poses]
        require_steady_stamps(stamps, f"{path} {topic}, plan {len(found) + 1}")
        places = [each.pose for each in message.poses]
        found.append(
            ToolPath(
                stamps_ns=np.array(stamps, np.int64),
                positions=np.array([[each.position.x, each.position.y, each.position.z] for each in places]),
                quaternions=np.array(
                    [
                        [each.orientation.x, each.orientation.y, each.orientation.z, each.orientation.w]
                        for each in places
                    ]
                ),
            )
        )
    return found
