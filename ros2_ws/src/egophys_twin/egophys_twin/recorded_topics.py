"""Which topic of a recording a name means: recordings and the node that learns from them may be in namespaces.

A recording made beside the node has the node's full names (`/lab/object/points`), one made elsewhere those at the root
(`/object/points`). Imports no ROS.
"""

from collections.abc import Sequence
from dataclasses import replace

from egophys_core.episode_source import EpisodeSource
from egophys_core.recording import TopicInfo


def topic_in(topics: Sequence[TopicInfo], name: str, namespace: str) -> str:
    """The name if the recording has such messages, else the same without the namespace if it has those.

    Args:
        topics: of a bag or a log (`list_topics`).
        name: full name of a topic.
        namespace: of the node that was told the name, `/` for none.
    """
    at_root = name.removeprefix(namespace.rstrip("/"))
    recorded = {topic.name for topic in topics if topic.messages}
    return at_root if at_root in recorded and name not in recorded else name


def source_in(topics: Sequence[TopicInfo], source: EpisodeSource, namespace: str) -> EpisodeSource:
    """The source with the names that its topics have in a recording, of which `topics` are those."""
    return replace(
        source,
        object_topic=topic_in(topics, source.object_topic, namespace),
        controller_topic=topic_in(topics, source.controller_topic, namespace),
    )
