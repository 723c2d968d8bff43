"""The bridge, configured and activated, with the xArm emulator in front of it unless told otherwise.

ros2 launch xarm_bridge bridge.launch.py
ros2 launch xarm_bridge bridge.launch.py use_emulator:=false robot_ip:=192.168.1.200 calibration_file:=PATH
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    config = Path(get_package_share_directory("xarm_bridge")) / "config"
    arguments = {
        "use_emulator": ("true", "start the xArm6 emulator on robot_ip"),
        "robot_ip": ("127.0.0.1", "address of the control box, or loopback address of the emulator"),
        "calibration_file": (str(config / "world_to_base.yaml"), "YAML file with world_to_base and tool"),
        "params_file": (str(config / "bridge.yaml"), "parameters of bridge_node: workspace and limits"),
    }
    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in arguments.items()
            ],
            Node(
                package="xarm_bridge",
                executable="emulator",
                arguments=["--host", LaunchConfiguration("robot_ip")],
                condition=IfCondition(LaunchConfiguration("use_emulator")),
                output="screen",
            ),
            Node(
                package="xarm_bridge",
                executable="bridge_node",
                name="bridge_node",
                parameters=[
                    LaunchConfiguration("params_file"),
                    {
                        "robot_ip": LaunchConfiguration("robot_ip"),
                        "calibration_file": LaunchConfiguration("calibration_file"),
                        "autostart": True,
                    },
                ],
                output="screen",
            ),
        ]
    )
