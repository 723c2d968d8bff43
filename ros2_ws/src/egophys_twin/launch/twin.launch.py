"""The twin node, configured and activated.

ros2 launch egophys_twin twin.launch.py
ros2 launch egophys_twin twin.launch.py twin_path:=PATH
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    config = Path(get_package_share_directory("egophys_twin")) / "config"
    arguments = {
        "twin_path": ("", "twin file to use from the start; empty for none"),
        "twin_params_file": (str(config / "twin.yaml"), "parameters of twin_node: topics and options of the fit"),
    }
    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in arguments.items()
            ],
            Node(
                package="egophys_twin",
                executable="twin_node",
                name="twin_node",
                parameters=[
                    LaunchConfiguration("twin_params_file"),
                    {
                        "twin_path": ParameterValue(LaunchConfiguration("twin_path"), value_type=str),
                        "autostart": True,
                    },
                ],
                output="screen",
            ),
        ]
    )
