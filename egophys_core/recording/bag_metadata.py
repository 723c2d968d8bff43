"""`metadata.yaml` of a rosbag2 folder, version 9, as ROS 2 Jazzy writes it.

Field by field after rosbag2's `rosbag2_storage/yaml.hpp`, `qos.cpp` (policies by name since version 9) and
`SequentialWriter::init_metadata` (an empty bag starts at the largest time there is).
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml
from rosbags.interfaces import QosDurability, QosReliability

from egophys_core.errors import RecordingError

METADATA_NAME = "metadata.yaml"
METADATA_VERSION = 9
INFORMATION_KEY = "rosbag2_bagfile_information"
LOST_KEY = "lost_messages"
"""In `custom_data`, which rosbag2 leaves to its users: JSON of the messages of each topic that the recorder missed."""
ROS_DISTRO = "jazzy"
_NO_MESSAGES_START = 2**63 - 1
_INFINITE = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True, kw_only=True)
class TopicQos:
    """The quality of service a topic's publishers offer; `ros2 bag play` offers the same."""

    reliability: QosReliability = QosReliability.RELIABLE
    durability: QosDurability = QosDurability.VOLATILE
    depth: int = 10
    """Messages kept for a late or slow reader (history is always keep-last)."""

    def __post_init__(self) -> None:
        if self.depth < 1:
            raise RecordingError(f"QoS depth must be at least 1, got {self.depth}")


SENSOR_QOS = TopicQos(reliability=QosReliability.BEST_EFFORT, depth=5)
"""rclpy's sensor-data profile."""

LATCHED_QOS = TopicQos(durability=QosDurability.TRANSIENT_LOCAL, depth=1)
"""State that a late subscriber must get: reliable, transient local, depth 1."""


@dataclass(frozen=True, kw_only=True)
class BagTopic:
    """A topic as the metadata lists it."""

    name: str
    type: str
    type_hash: str
    qos: TopicQos


def qos_text(qos: TopicQos) -> str:
    """YAML of one offered profile, as a channel's `offered_qos_profiles` carries it."""
    return _yaml(_offered_profiles(qos)).strip()


def bag_information(
    *,
    file_name: str,
    topics: Sequence[BagTopic],
    counts: Mapping[str, int],
    lost: Mapping[str, int],
    start_ns: int | None,
    end_ns: int | None,
) -> dict[str, Any]:
    """The `rosbag2_bagfile_information` of a bag of one MCAP file.

    Args:
        file_name: name of the file in the folder.
        topics: every topic of the bag.
        counts: messages of each topic.
        lost: messages of topics that did not reach the recorder; empty for none.
        start_ns: earliest log time, nanoseconds since the epoch; None while there is no message.
        end_ns: latest log time.
    """
    duration = {"nanoseconds": 0 if start_ns is None or end_ns is None else end_ns - start_ns}
    starting_time = {"nanoseconds_since_epoch": _NO_MESSAGES_START if start_ns is None else start_ns}
    message_count = sum(counts.values())
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": starting_time,
        "message_count": message_count,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": _offered_profiles(topic.qos),
                    "type_description_hash": topic.type_hash,
                },
                "message_count": counts[topic.name],
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [
            {
                "path": file_name,
                "starting_time": starting_time,
                "duration": duration,
                "message_count": message_count,
            }
        ],
        "custom_data": {LOST_KEY: json.dumps(dict(lost))} if lost else None,
        "ros_distro": ROS_DISTRO,
    }


def metadata_text(information: dict[str, Any]) -> str:
    """Content of `metadata.yaml`."""
    return _yaml({INFORMATION_KEY: information})


def embedded_text(information: dict[str, Any]) -> str:
    """What the MCAP file itself carries, so that it is understood outside its folder."""
    return _yaml(information)


def _offered_profiles(qos: TopicQos) -> list[dict[str, Any]]:
    return [
        {
            "history": "keep_last",
            "depth": qos.depth,
            "reliability": qos.reliability.name.lower(),
            "durability": qos.durability.name.lower(),
            "deadline": _INFINITE,
            "lifespan": _INFINITE,
            "liveliness": "automatic",
            "liveliness_lease_duration": _INFINITE,
            "avoid_ros_namespace_conventions": False,
        }
    ]


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        """Write equal parts out in full, as rosbag2 does."""
        return True


def _yaml(content: Any) -> str:
    # Not folding long names; the field order is kept.
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, width=4096)
