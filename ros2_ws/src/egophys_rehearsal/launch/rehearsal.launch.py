"""The rehearsal, configured and activated: a soft object that stands in for the lab.

ros2 launch egophys_rehearsal rehearsal.launch.py effects:=control_delay        # handled by the arm of the bridge
ros2 launch egophys_rehearsal rehearsal.launch.py object:=box hands:=lift       # by scripted hands
ros2 launch egophys_twin egophys.launch.py use_rehearsal:=true effects:=quadratic_drag log_folder:=PATH
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

CHOICES = {
    "object": ("sheet", "what lies on the table: sheet, ellipsoid or box"),
    "hands": ("arm", "who handles it: arm, or a scripted motion, for example lift"),
    "effects": ("none", "names of the effects to inject, separated by spaces"),
    "effect_size": ("large", "size of the effects: small or large"),
}


def generate_launch_description() -> LaunchDescription:
    config = Path(get_package_share_directory("egophys_rehearsal")) / "config"
    arguments = {
        **CHOICES,
        "rehearsal_params_file": (str(config / "rehearsal.yaml"), "parameters of rehearsal_node"),
    }
    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in arguments.items()
            ],
            Node(
                package="egophys_rehearsal",
                executable="rehearsal_node",
                name="rehearsal_node",
                parameters=[
                    LaunchConfiguration("rehearsal_params_file"),
                    {
                        **{name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in CHOICES},
                        "autostart": True,
                    },
                ],
                output="screen",
            ),
        ]
    )
