"""Whether a recording is whole and what is in it, before work that takes long: by its index where it has one."""

import struct
import warnings
from pathlib import Path

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader

from egophys_core.errors import RecordingError
from egophys_core.recording.losses import find_unreadable
from egophys_core.recording.mcap_file import MAGIC, RECORD_HEAD
from egophys_core.recording.reader import list_topics, storage_files
from egophys_core.recording.records import NO_FOOTER, CutRecordingWarning, TopicInfo

_ADVICE = (
    "Copy it again from where it was recorded; `egophys build` and `egophys diagnose` take the part that is readable"
)


def inspect_recording(path: Path) -> list[TopicInfo]:
    """Topics of a whole recording with type and number of messages.

    MCAP files with an index are not read through: only that each chunk is where the index says. A file that ends
    without an index between two records, as a killed recorder leaves it, counts as whole.

    Args:
        path: an `.mcap` or `.db3` file or a rosbag2 folder.

    Raises:
        RecordingError: not a bag, or cut or damaged; says where.
    """
    files = storage_files(path)
    indexed = [_indexed_topics(file) for file in files]
    topics = _read_topics(path) if None in indexed else _added([each or [] for each in indexed])
    unreadable = find_unreadable(path, topics)
    if unreadable:
        raise RecordingError(f"{path}: {'; '.join(map(str, unreadable))}. {_ADVICE}")
    return topics


def _read_topics(path: Path) -> list[TopicInfo]:
    """Read all of it.

    Raises:
        RecordingError: not a bag, or cut or damaged.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", CutRecordingWarning)
        topics = list_topics(path)
    for each in caught:
        if isinstance(each.message, CutRecordingWarning) and each.message.reason != NO_FOOTER:
            raise RecordingError(f"{each.message}. {_ADVICE}")
    return topics


def _indexed_topics(file: Path) -> list[TopicInfo] | None:
    """Topics by the index of one MCAP file; None if it has none that is right."""
    try:
        with file.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                return None
            summary = make_reader(stream).get_summary()
            if summary is None or summary.statistics is None:
                return None
            for chunk in summary.chunk_indexes:
                stream.seek(chunk.chunk_start_offset)
                opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
                if opcode != Opcode.CHUNK or RECORD_HEAD.size + length != chunk.chunk_length:
                    return None
            types = {number: schema.name for number, schema in summary.schemas.items()}
            counts = summary.statistics.channel_message_counts
            return [
                TopicInfo(name=each.topic, type=types.get(each.schema_id, ""), messages=counts.get(number, 0))
                for number, each in summary.channels.items()
            ]
    except (OSError, McapError, ValueError, struct.error):
        return None


def _added(files: list[list[TopicInfo]]) -> list[TopicInfo]:
    """Topics of several files, the messages of each counted together."""
    messages: dict[tuple[str, str], int] = {}
    for topic in (topic for topics in files for topic in topics):
        key = topic.name, topic.type
        messages[key] = messages.get(key, 0) + topic.messages
    return [TopicInfo(name=name, type=kind, messages=count) for (name, kind), count in messages.items()]
