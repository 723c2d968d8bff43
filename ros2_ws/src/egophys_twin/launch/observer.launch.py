"""The observer of the live camera, configured and activated.

ros2 launch egophys_twin observer.launch.py
ros2 launch egophys_twin observer.launch.py image_topic:=/camera/image_raw image_transport:=raw
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

CAMERA = ("image_topic", "image_transport", "camera_info_topic")


def generate_launch_description() -> LaunchDescription:
    config = Path(get_package_share_directory("egophys_twin")) / "config"
    arguments = {
        "image_topic": ("/ego/image_raw/compressed", "topic of the camera's images"),
        "image_transport": ("compressed", "compressed or raw images"),
        "camera_info_topic": ("/ego/camera_info", "topic of the camera's calibration"),
        "observer_params_file": (
            str(config / "observer.yaml"),
            "parameters of observer_node: topics, options of perception, the board",
        ),
    }
    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in arguments.items()
            ],
            Node(
                package="egophys_twin",
                executable="observer_node",
                name="observer_node",
                parameters=[
                    LaunchConfiguration("observer_params_file"),
                    {
                        **{name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in CAMERA},
                        "autostart": True,
                    },
                ],
                output="screen",
            ),
        ]
    )
