"""The planner, configured and activated; it asks the twin node for rollouts.

ros2 launch egophys_planner planner.launch.py
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    config = Path(get_package_share_directory("egophys_planner")) / "config"
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "planner_params_file",
                default_value=str(config / "planner.yaml"),
                description="parameters of mppi_planner_node: names, timeouts and options of the planner",
            ),
            Node(
                package="egophys_planner",
                executable="mppi_planner_node",
                name="mppi_planner_node",
                parameters=[LaunchConfiguration("planner_params_file"), {"autostart": True}],
                output="screen",
            ),
        ]
    )
