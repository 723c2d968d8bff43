"""A log of the nodes: whose topics are in it, its messages, and what of them is lost."""

import json
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from egophys_core.errors import RecordingError
from egophys_core.recording import (
    CutRecordingWarning,
    Record,
    find_lost,
    list_topics,
    read_records,
    types_of_topics,
    xyz_of_message,
)
from egophys_core.twin import Twin, decode_twin

TWIN_NODE, PLANNER_NODE = "twin_node", "mppi_planner_node"
"""Names of the nodes without their namespace."""


class ReplayedLog:
    """The records of the twin node and the planner in a log, by topic, decoded when asked for."""

    def __init__(self, path: Path, *, twin_node: str | None = None, planner_node: str | None = None) -> None:
        """Read the log.

        Args:
            path: a rosbag2 folder or an MCAP file.
            twin_node: full name of the twin node; None finds it.
            planner_node: of the planner.

        Raises:
            RecordingError: not a log, it has no topic of the nodes, or those of several.
        """
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", CutRecordingWarning)
            topics = list_topics(path)
        names = [topic.name for topic in topics]
        self.path = path
        self.twin_node = _node_named(TWIN_NODE, names, twin_node, path, "--twin-node")
        self.planner_node = _node_named(PLANNER_NODE, names, planner_node, path, "--planner-node")
        self.lost = [str(each) for each in find_lost(path, topics)] + [str(each.message) for each in caught]
        """What the log is known to lack, a sentence each."""
        of_nodes = [name for name in names if name.startswith((f"{self.twin_node}/", f"{self.planner_node}/"))]
        if not of_nodes:
            raise RecordingError(
                f"{path}: no topic of {self.twin_node} or {self.planner_node} to replay; the log has {', '.join(names)}"
            )
        self._types = types_of_topics(topics)
        self._records: dict[str, list[Record]] = {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CutRecordingWarning)  # told in `lost`
            for record in read_records(path, of_nodes):
                self._records.setdefault(record.topic, []).append(record)

    def records(self, topic: str) -> list[Record]:
        """In the order they were written."""
        return self._records.get(topic, [])

    def last(self, topic: str) -> Record | None:
        """None if the topic has no message."""
        return self._records[topic][-1] if topic in self._records else None

    def decode(self, record: Record) -> Any:
        """The message in a record.

        Raises:
            RecordingError: it is not readable, or the log does not say what is in it.
        """
        try:
            return self._types.deserialize_cdr(record.cdr, record.type)
        except KeyError as error:
            raise RecordingError(
                f"{self.path}: the log does not hold the definition of {error.args[0]}, which {record.topic} needs; "
                "record it as MCAP with definitions"
            ) from error
        except SerdeError as error:
            raise RecordingError(f"{self.path}: a message on {record.topic} is not readable: {error}") from error

    def points(self, record: Record) -> np.ndarray:
        """[P, 3] float32 metres of a PointCloud2."""
        return xyz_of_message(self.decode(record), source=f"{self.path} {record.topic}")

    def decode_json(self, record: Record, required: Sequence[str]) -> dict[str, Any]:
        """The JSON object in a std_msgs/String, which must have the `required` keys.

        Raises:
            RecordingError: it is none, or lacks one.
        """
        text = self.decode(record).data
        try:
            content = json.loads(text)
        except json.JSONDecodeError as error:
            raise RecordingError(f"{self.path}: {record.topic} is not JSON: {error}") from error
        missing = [key for key in required if not isinstance(content, dict) or key not in content]
        if missing:
            raise RecordingError(
                f"{self.path}: {record.topic} lacks {', '.join(missing)}; was the log made by another version?"
            )
        return dict(content)

    def decode_twin(self, record: Record) -> Twin:
        """The twin in a message on the twin node's `model`."""
        return decode_twin(bytes(self.decode(record).data), name=f"{self.path} {record.topic}")

    def twin_with_id(self, twin_id: str) -> Twin | None:
        """None if the log has no model of it."""
        twins = (self.decode_twin(record) for record in reversed(self.records(f"{self.twin_node}/model")))
        return next((twin for twin in twins if twin.twin_id == twin_id), None)


def _node_named(name: str, topics: Sequence[str], chosen: str | None, path: Path, option: str) -> str:
    """Full name of a node: the one that is chosen, or the one of that name in the log, whatever its namespace.

    Raises:
        RecordingError: nodes of several namespaces have that name.
    """
    if chosen is not None:
        return chosen
    inside = f"/{name}/"
    found = sorted({topic[: topic.index(inside) + len(inside) - 1] for topic in topics if inside in topic})
    if len(found) > 1:
        raise RecordingError(f"{path}: recorded of {' and '.join(found)}; choose one with {option}")
    return found[0] if found else f"/{name}"
