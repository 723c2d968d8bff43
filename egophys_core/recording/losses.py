"""What a recording lacks, by what its recorder said of it: messages that never came, and that are no longer there."""

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader

from egophys_core.recording.bag_metadata import INFORMATION_KEY, LOST_KEY, METADATA_NAME
from egophys_core.recording.records import TopicInfo


@dataclass(frozen=True, kw_only=True)
class LostMessages:
    """Messages of one topic that were published while it was recorded and are not in the recording."""

    topic: str
    messages: int
    reason: str

    def __str__(self) -> str:
        """For a person."""
        return f"{self.messages} message{'' if self.messages == 1 else 's'} lost on {self.topic}: {self.reason}"


def find_lost(path: Path, topics: Sequence[TopicInfo]) -> list[LostMessages]:
    """Compare what is readable with what the recorder said that it was not given and that it wrote.

    A recording without such words, as one made by hand, lacks nothing that could be told.

    Args:
        path: an `.mcap` file or a rosbag2 folder.
        topics: what is readable of it (`list_topics`).
    """
    missed = [
        LostMessages(topic=topic, messages=messages, reason="they did not reach the recorder")
        for topic, messages in _not_received(_information(path)).items()
    ]
    return missed + find_unreadable(path, topics)


def find_unreadable(path: Path, topics: Sequence[TopicInfo]) -> list[LostMessages]:
    """What the recorder said that it wrote and is not readable; arguments as of `find_lost`."""
    readable = {topic.name: topic.messages for topic in topics}
    found = []
    for topic, written in _written(_information(path)).items():
        count = readable.get(topic, 0)
        if written > count:
            reason = f"{written} {'was' if written == 1 else 'were'} written, {count} can be read"
            found.append(LostMessages(topic=topic, messages=written - count, reason=reason))
    return found


def _information(path: Path) -> Mapping[str, Any]:
    """The `rosbag2_bagfile_information`; empty where there is none, or none that is readable."""
    try:
        if path.is_dir():
            content = yaml.safe_load((path / METADATA_NAME).read_text("utf-8"))[INFORMATION_KEY]
        else:
            with path.open("rb") as stream:
                texts = [each.metadata["serialized_metadata"] for each in make_reader(stream).iter_metadata()]
            content = yaml.safe_load(texts[-1])
    except (OSError, UnicodeDecodeError, struct.error, yaml.YAMLError, McapError, KeyError, TypeError, IndexError):
        return {}
    return content if isinstance(content, dict) else {}


def _not_received(information: Mapping[str, Any]) -> dict[str, int]:
    try:
        lost = json.loads(information["custom_data"][LOST_KEY])
        return {str(topic): int(messages) for topic, messages in lost.items()}
    except (KeyError, TypeError, ValueError, AttributeError):
        return {}


def _written(information: Mapping[str, Any]) -> dict[str, int]:
    try:
        topics = information["topics_with_message_count"]
        return {str(each["topic_metadata"]["name"]): int(each["message_count"]) for each in topics}
    except (KeyError, TypeError, ValueError):
        return {}
