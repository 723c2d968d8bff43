"""What a bag holds: serialized records and their topics; and what is said when a file is damaged."""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from egophys_core.errors import RecordingError

NO_FOOTER = "ends without a footer (recorder killed, or file cut)"
"""Why reading ended early where nothing shows that a record is missing."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """One message as it was recorded, not decoded."""

    topic: str
    """Full topic name, `/object/points`."""
    type: str
    """ROS type name, `sensor_msgs/msg/PointCloud2`; empty where the file names none."""
    log_time_ns: int
    """When the recorder received it, nanoseconds since the epoch."""
    cdr: bytes
    """The serialized message with its four bytes of CDR encapsulation."""


@dataclass(frozen=True, kw_only=True)
class TopicInfo:
    """A topic of a bag and how many messages of it are readable."""

    name: str
    type: str
    messages: int
    definition: str = field(default="", compare=False)
    """Text of the message type as the bag carries it (`ros2msg`); empty where it carries none."""


class CutRecordingWarning(UserWarning):
    """A file of a recording is cut or damaged; says what was read all the same."""

    def __init__(self, path: Path, offset: int | None, reason: str, what_was_read: str) -> None:
        super().__init__(f"{path}: {reason}{_at(offset)}; {what_was_read}")
        self.path = path
        self.offset = offset
        """Byte of the damage; None where it is not known (a database)."""
        self.reason = reason


class DamagedFileError(RecordingError):
    """A storage file cannot be read beyond `offset`; raised after all records before it were yielded."""

    def __init__(self, path: Path, offset: int | None, reason: str) -> None:
        super().__init__(
            f"{path}: {reason}{_at(offset)}; no message before it is readable. Copy the bag again from where "
            "it was recorded"
        )
        self.path = path
        self.offset = offset
        self.reason = reason


def _at(offset: int | None) -> str:
    return "" if offset is None else f" (byte {offset})"


class TopicTable:
    """The topics met while reading a bag, in the order they were met, with their counts."""

    def __init__(self) -> None:
        self._types: dict[str, str] = {}
        self._messages: dict[str, int] = {}
        self._definitions: dict[str, str] = {}

    def declare(self, name: str, type_name: str, definition: str = "") -> None:
        """Note that the bag has this topic, even if no message of it follows."""
        self._types.setdefault(name, type_name)
        self._messages.setdefault(name, 0)
        self._definitions.setdefault(name, definition)

    def count(self, name: str) -> None:
        """Note one readable message of a declared topic."""
        self._messages[name] += 1

    @property
    def total(self) -> int:
        """Readable messages of all topics together."""
        return sum(self._messages.values())

    def topics(self) -> list[TopicInfo]:
        """All topics with type and message count."""
        return [
            TopicInfo(
                name=name,
                type=type_name,
                messages=self._messages[name],
                definition=self._definitions[name],
            )
            for name, type_name in self._types.items()
        ]

    def require(self, path: Path, wanted: Iterable[str]) -> None:
        """Check that every wanted topic was met.

        Raises:
            RecordingError: one was not; names the topics there are and the nearest one.
        """
        for name in wanted:
            if name in self._types:
                continue
            there = ", ".join(f"{t.name} ({t.type}, {t.messages} messages)" for t in self.topics())
            nearest = difflib.get_close_matches(name, self._types, n=1, cutoff=0.4)
            hint = f". Did you mean {nearest[0]}?" if nearest else ""
            raise RecordingError(f"{path}: no topic {name}; the bag has {there or 'no topics at all'}{hint}")
