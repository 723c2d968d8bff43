"""Parameters of the twin node that say how recordings become episodes."""

from typing import Any

from egophys_ros_common import names
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_names, declare_options

from egophys_core.episode_source import EpisodeSource, SourceOptions
from egophys_core.perception.camera.board import Board
from egophys_core.perception.options import PerceptionOptions

SOURCE_GROUPS: tuple[tuple[type[Any], str], ...] = (
    (SourceOptions, ""),
    (PerceptionOptions, "perception."),
    (Board, "board."),
)
"""Classes of options and the prefixes of their parameters."""

ELSEWHERE = "of a recording without it, the same name at the root (/object/points for /lab/object/points)"
TOPIC_PARAMETERS = {
    "object_topic": (names.OBJECT_POINTS, f"topic of the object's points in the recordings to learn from; {ELSEWHERE}"),
    "controller_topic": (names.CONTROLLER_POINTS, f"topic of the hands' points in those recordings; {ELSEWHERE}"),
    "executed_topic": (names.EXECUTED, f"topic that says in a log which plans the bridge executed; {ELSEWHERE}"),
}


def declare_source(node: ManagedNode) -> None:
    """Declare topics and options; they are read for each request."""
    declare_names(node, TOPIC_PARAMETERS, at_once=True)
    for options, prefix in SOURCE_GROUPS:
        declare_options(node, options, prefix, at_once=True)


def episode_source(
    node: ManagedNode, choice: SourceOptions, perception: PerceptionOptions, board: Board
) -> EpisodeSource:
    """How recordings become episodes, by the topics of the parameters and the options of `SOURCE_GROUPS`."""
    return EpisodeSource(
        source=choice.source,
        force=choice.force,
        held=choice.held,
        no_table=choice.no_table,
        object_topic=recorded_name(node, "object_topic"),
        controller_topic=recorded_name(node, "controller_topic"),
        perception=perception,
        board=board,
    )


def recorded_name(node: ManagedNode, parameter: str) -> str:
    """Full name of the topic that a parameter names."""
    return str(node.resolve_topic_name(node.get_parameter(parameter).value))
