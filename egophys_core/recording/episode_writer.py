"""Episode -> rosbag2 folder, in the conventions `read_episode` reads."""

from pathlib import Path

import numpy as np

from egophys_core.episode import WORLD_FRAME, Episode
from egophys_core.recording.bag_metadata import SENSOR_QOS
from egophys_core.recording.episode_reader import CONTROLLER_TOPIC, OBJECT_TOPIC
from egophys_core.recording.log_writer import LogWriter
from egophys_core.recording.new_bag import new_bag
from egophys_core.recording.pointcloud import POINTCLOUD2, encode_points


def write_episode(
    episode: Episode,
    folder: Path | str,
    *,
    start_ns: int = 0,
    object_topic: str = OBJECT_TOPIC,
    controller_topic: str = CONTROLLER_TOPIC,
    frame: str = WORLD_FRAME,
) -> None:
    """Write an episode as a rosbag2 MCAP folder, whole or not at all; points not seen are left out of their message.

    The bag does not hold the episode's name and ground height.

    Args:
        episode: what to write.
        folder: must not exist.
        start_ns: header stamp and log time of the first frame, nanoseconds since the epoch.
        object_topic: topic of the object's points.
        controller_topic: topic of the points of the hands.
        frame: `frame_id` of every message.

    Raises:
        RecordingError, OutputError: the folder exists or the disk refuses.
    """
    stamps_ns = start_ns + np.rint(episode.times * 1e9).astype(np.int64)
    certain = np.ones(len(episode.controller_ids), np.float32)
    seen = episode.visible & (episode.confidence > 0)
    with new_bag(Path(folder)) as part, LogWriter(part) as log:
        log.add_topic(object_topic, POINTCLOUD2, SENSOR_QOS)
        log.add_topic(controller_topic, POINTCLOUD2, SENSOR_QOS)
        for index, stamp_ns in enumerate(stamps_ns.tolist()):
            mask = seen[index]
            log.write(
                object_topic,
                encode_points(
                    stamp_ns=stamp_ns,
                    frame_id=frame,
                    xyz=episode.points[index, mask],
                    ids=episode.point_ids[mask],
                    confidence=episode.confidence[index, mask],
                ),
                stamp_ns,
            )
            log.write(
                controller_topic,
                encode_points(
                    stamp_ns=stamp_ns,
                    frame_id=frame,
                    xyz=episode.controllers[index],
                    ids=episode.controller_ids,
                    confidence=certain,
                    contact=None if episode.contact is None else episode.contact[index],
                ),
                stamp_ns,
            )
