"""Bags and logs in and out (MCAP, rosbag2 folders) <-> arrays. Imports neither ROS, Warp nor torch."""

from egophys_core.episode import EpisodeWarning
from egophys_core.recording.bag_metadata import LATCHED_QOS, SENSOR_QOS, TopicQos
from egophys_core.recording.episode_reader import (
    CONTROLLER_TOPIC,
    OBJECT_TOPIC,
    decode_episode,
    read_episode,
)
from egophys_core.recording.episode_writer import write_episode
from egophys_core.recording.inspection import inspect_recording
from egophys_core.recording.log_writer import LogWriter
from egophys_core.recording.losses import LostMessages, find_lost
from egophys_core.recording.message_definitions import (
    MessageDefinition,
    definition_from_folder,
    jazzy_types,
    standard_definition,
    types_of_topics,
)
from egophys_core.recording.pointcloud import (
    POINT_DTYPE,
    POINT_FIELDS,
    PointFrame,
    decode_points,
    encode_points,
    pack_points,
    points_of_message,
    xyz_of_message,
)
from egophys_core.recording.reader import list_topics, read_records
from egophys_core.recording.records import CutRecordingWarning, Record, TopicInfo
from egophys_core.recording.stamps import require_steady_stamps

__all__ = [
    "CONTROLLER_TOPIC",
    "LATCHED_QOS",
    "OBJECT_TOPIC",
    "POINT_DTYPE",
    "POINT_FIELDS",
    "SENSOR_QOS",
    "CutRecordingWarning",
    "EpisodeWarning",
    "LogWriter",
    "LostMessages",
    "MessageDefinition",
    "PointFrame",
    "Record",
    "TopicInfo",
    "TopicQos",
    "decode_episode",
    "decode_points",
    "definition_from_folder",
    "encode_points",
    "find_lost",
    "inspect_recording",
    "jazzy_types",
    "list_topics",
    "pack_points",
    "points_of_message",
    "read_episode",
    "read_records",
    "require_steady_stamps",
    "standard_definition",
    "types_of_topics",
    "write_episode",
    "xyz_of_message",
]
