"""ROS 2 message definitions as logs carry them: the text of the type and all it contains, and its hash."""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from egophys_core.errors import RecordingError
from egophys_core.recording.records import TopicInfo


@dataclass(frozen=True, kw_only=True)
class MessageDefinition:
    """What a log says of a message type, so that it is readable without the package that defines it."""

    type: str
    """`egophys_msgs/msg/TwinInfo`."""
    text: str
    """`ros2msg` schema: the definition, then each contained type below 80 `=` and `MSG: pkg/Name`."""
    type_hash: str
    """`RIHS01_...`, the ROS Interface Hash (REP-2016)."""


@cache
def jazzy_types() -> Typestore:
    """The standard messages of ROS 2 Jazzy; shared, not to be added to."""
    return get_typestore(Stores.ROS2_JAZZY)


def standard_definition(type_name: str) -> MessageDefinition:
    """Definition of a message that ROS 2 Jazzy has (std_msgs, sensor_msgs, geometry_msgs, nav_msgs, ...).

    Raises:
        RecordingError: it is none of them.
    """
    return _definition(jazzy_types(), type_name, "pass its definition (definition_from_folder)")


def definition_from_folder(type_name: str, *folders: Path) -> MessageDefinition:
    """Definition of a message from the `.msg` files of its package, and of those it contains.

    Args:
        type_name: `egophys_msgs/msg/TwinInfo`.
        folders: the installed `share/<package>/msg` folder of every package involved that is not part of
            ROS 2 itself; the package's name is that of the folder above `msg`.

    Raises:
        RecordingError: no such message, or a `.msg` file is not readable.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for folder in folders:
        package = folder.resolve().parent.name
        for file in sorted(folder.glob("*.msg")):
            try:
                store.register(get_types_from_msg(file.read_text("utf-8"), f"{package}/msg/{file.stem}"))
            except (TypesysError, UnicodeDecodeError, OSError) as error:
                raise RecordingError(f"{file}: not a readable message definition: {error}") from error
    where = ", ".join(str(folder) for folder in folders)
    return _definition(store, type_name, f"looked in {where}; is the package built and sourced?")


def types_of_topics(topics: Iterable[TopicInfo]) -> Typestore:
    """The standard messages and those that a bag's topics define, to decode its records with.

    Raises:
        RecordingError: a definition in the bag is not readable.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for topic in topics:
        if topic.type in store.fielddefs or not topic.definition:
            continue
        try:
            found = get_types_from_msg(topic.definition, topic.type)
        except TypesysError as error:
            raise RecordingError(f"{topic.name}: its definition of {topic.type} is not readable: {error}") from error
        store.register({name: fields for name, fields in found.items() if name not in store.fielddefs})
    return store


def _definition(store: Typestore, type_name: str, advice: str) -> MessageDefinition:
    try:
        text, _ = store.generate_msgdef(type_name, ros_version=2)
    except TypesysError as error:
        nearest = difflib.get_close_matches(type_name, store.fielddefs, n=1)
        hint = f" (did you mean {nearest[0]}?)" if nearest else ""
        raise RecordingError(f"no definition of message type {type_name}{hint}: {error} {advice}") from error
    return MessageDefinition(type=type_name, text=text, type_hash=store.hash_rihs01(type_name))
