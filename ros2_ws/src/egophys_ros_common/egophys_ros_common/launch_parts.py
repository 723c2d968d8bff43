"""What the launch files share: arguments, checks before anything starts, and nodes that end or come back.

For launch files only, which run in the Python of `launch`: the nodes' own packages are not imported.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from egophys_ros_common.exit_codes import BAD_PARAMETERS, COULD_NOT_START

RESPAWN_DELAY_S = 2.0


def argument(name: str, default: str, description: str, choices: Sequence[str] = ()) -> DeclareLaunchArgument:
    """An argument of a launch file; `choices` are all it can be."""
    return DeclareLaunchArgument(
        name, default_value=default, description=description, choices=list(choices) if choices else None
    )


def switch(name: str, default: str, description: str) -> DeclareLaunchArgument:
    """An argument that is true or false."""
    return argument(name, default, description, ("true", "false"))


def common_arguments() -> list[DeclareLaunchArgument]:
    """Those of every launch file."""
    levels = ("debug", "info", "warn", "error", "fatal")
    return [
        argument("namespace", "", "namespace of all nodes, as lab; empty for none"),
        argument("log_level", "info", "least severity of what the nodes log", levels),
        switch("respawn", "true", "start nodes that crashed again; those of arm and log end the launch instead"),
    ]


def share(package: str, *parts: str) -> Path:
    """A file or folder that a package installs."""
    return Path(get_package_share_directory(package), *parts)


def check(function: Callable[[Mapping[str, str]], None]) -> OpaqueFunction:
    """Look at the values of all arguments; an exception ends the launch with its message."""
    return OpaqueFunction(function=lambda context: function(context.launch_configurations))


def text(name: str) -> ParameterValue:
    """A parameter that has an argument's value as it is, also where that looks like a number."""
    return ParameterValue(LaunchConfiguration(name), value_type=str)


def lifecycle_node(
    package: str,
    executable: str,
    *,
    params_file: str,
    parameters: Mapping[str, Any] | None = None,
    ends_launch: str = "",
    condition: Any = None,
) -> Node:
    """A node of this project, which configures and activates itself.

    Args:
        package: that installs it.
        executable: its name, and that of the node.
        params_file: argument that names its file of parameters.
        parameters: that win over the file's.
        ends_launch: why the launch ends when the node does; empty for a node that is started again after a crash.
        condition: under which it is started.
    """
    fate: dict[str, Any] = (
        {"on_exit": Shutdown(reason=f"{executable} ended: {ends_launch}")}
        if ends_launch
        else {
            "respawn": LaunchConfiguration("respawn"),
            "respawn_delay": RESPAWN_DELAY_S,
            "on_exit": _end_if_it_cannot_start,
        }
    )
    return Node(
        package=package,
        executable=executable,
        name=executable,
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration(params_file), {**(parameters or {}), "autostart": True}],
        arguments=log_level_words(),
        output="screen",
        condition=condition,
        **fate,
    )


def log_level_words() -> list[Any]:
    """Words on the command line of a node that set its log level."""
    return ["--ros-args", "--log-level", LaunchConfiguration("log_level")]


def launch_file(package: str, name: str) -> PythonLaunchDescriptionSource:
    """A launch file that a package installs."""
    return PythonLaunchDescriptionSource(str(share(package, "launch", name)))


def arguments_and_checks(sources: Sequence[PythonLaunchDescriptionSource]) -> list[LaunchDescriptionEntity]:
    """Those of launch files that are to be included: all must pass before the first node starts."""
    descriptions: list[LaunchDescription] = [each.get_launch_description(LaunchContext()) for each in sources]
    kinds = (DeclareLaunchArgument, OpaqueFunction)
    return [entity for each in descriptions for entity in each.entities if isinstance(entity, kinds)]


def _end_if_it_cannot_start(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
    if event.returncode not in (COULD_NOT_START, BAD_PARAMETERS):
        return []
    return [Shutdown(reason=f"{event.process_name} cannot start as it was asked to; its output says why")]
