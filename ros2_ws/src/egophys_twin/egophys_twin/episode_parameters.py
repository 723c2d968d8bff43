"""Parameters of the twin node that say how recordings become episodes."""

from typing import Any

from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_options, declare_texts
from rclpy.node import Node

from egophys_core.episode_source import EpisodeSource, SourceOptions
from egophys_core.perception.camera.board import Board
from egophys_core.perception.options import PerceptionOptions
from egophys_core.recording import CONTROLLER_TOPIC, OBJECT_TOPIC

SOURCE_GROUPS: tuple[tuple[type[Any], str], ...] = (
    (SourceOptions, ""),
    (PerceptionOptions, "perception."),
    (Board, "board."),
)
"""Classes of options and the prefixes of their parameters."""

TOPIC_PARAMETERS = {
    "object_topic": (OBJECT_TOPIC, "topic of the object's points in the recordings to learn from"),
    "controller_topic": (CONTROLLER_TOPIC, "topic of the hands' points in the recordings to learn from"),
}


def declare_source(node: ManagedNode) -> None:
    """Declare topics and options; they are read for each request."""
    declare_texts(node, TOPIC_PARAMETERS, at_once=True)
    for options, prefix in SOURCE_GROUPS:
        declare_options(node, options, prefix, at_once=True)


def episode_source(node: Node, choice: SourceOptions, perception: PerceptionOptions, board: Board) -> EpisodeSource:
    """How recordings become episodes, by the topics of the parameters and the options of `SOURCE_GROUPS`."""
    return EpisodeSource(
        source=choice.source,
        object_topic=node.get_parameter("object_topic").value,
        controller_topic=node.get_parameter("controller_topic").value,
        perception=perception,
        board=board,
    )
