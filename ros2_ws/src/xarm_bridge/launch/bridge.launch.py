"""The bridge, configured and activated, with the xArm emulator in front of it unless told otherwise.

The launch ends when one of the two does. robot_state_publisher, where installed, tells tf where the links are.

ros2 launch xarm_bridge bridge.launch.py
ros2 launch xarm_bridge bridge.launch.py use_emulator:=false robot_ip:=192.168.1.200 calibration_file:=PATH
"""

from collections.abc import Mapping

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from egophys_ros_common.launch_checks import require_file, require_loopback
from egophys_ros_common.launch_parts import (
    RESPAWN_DELAY_S,
    argument,
    check,
    common_arguments,
    lifecycle_node,
    log_level_words,
    share,
    switch,
    text,
)
from launch import LaunchDescription, LaunchDescriptionEntity
from launch.actions import LogInfo, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    """Nodes and arguments."""
    return LaunchDescription(
        [
            switch("use_emulator", "true", "start the xArm6 emulator on robot_ip"),
            argument("robot_ip", "127.0.0.1", "address of the control box, or loopback address of the emulator"),
            argument(
                "calibration_file",
                str(share("xarm_bridge", "config", "world_to_base.yaml")),
                "YAML file with world_to_base and tool",
            ),
            argument(
                "params_file",
                str(share("xarm_bridge", "config", "bridge.yaml")),
                "parameters of bridge_node: workspace and limits",
            ),
            *common_arguments(),
            check(_check),
            Node(
                package="xarm_bridge",
                executable="emulator",
                arguments=["--host", LaunchConfiguration("robot_ip")],
                condition=IfCondition(LaunchConfiguration("use_emulator")),
                on_exit=Shutdown(reason="the emulator ended: there is no arm"),
                output="screen",
            ),
            lifecycle_node(
                "xarm_bridge",
                "bridge_node",
                params_file="params_file",
                parameters={
                    "robot_ip": text("robot_ip"),
                    "calibration_file": text("calibration_file"),
                    "allow_emulator": ParameterValue(LaunchConfiguration("use_emulator"), value_type=bool),
                },
                ends_launch="nothing drives the arm",
            ),
            _robot_state_publisher(),
        ]
    )


def _check(values: Mapping[str, str]) -> None:
    for name in ("params_file", "calibration_file"):
        require_file(name, values[name])
    if values["use_emulator"] == "true":
        require_loopback("robot_ip", values["robot_ip"])


def _robot_state_publisher() -> LaunchDescriptionEntity:
    try:
        get_package_prefix("robot_state_publisher")
    except PackageNotFoundError:
        return LogInfo(msg="robot_state_publisher is not installed: tf has the base and the tool, but no links between")
    urdf = share("xarm_bridge", "urdf", "xarm6.urdf").read_text()
    return Node(
        package="robot_state_publisher",
        executable="robot_state_publisher",
        name="robot_state_publisher",
        namespace=LaunchConfiguration("namespace"),
        parameters=[{"robot_description": ParameterValue(urdf, value_type=str)}],
        arguments=log_level_words(),
        respawn=LaunchConfiguration("respawn"),
        respawn_delay=RESPAWN_DELAY_S,
        output="screen",
    )
