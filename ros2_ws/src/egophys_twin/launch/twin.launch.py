"""The twin node, configured and activated.

ros2 launch egophys_twin twin.launch.py
ros2 launch egophys_twin twin.launch.py twin_path:=PATH
"""

from egophys_ros_common.launch_checks import require_file
from egophys_ros_common.launch_parts import argument, check, common_arguments, lifecycle_node, share, text
from launch import LaunchDescription

FILES = ("twin_path", "twin_params_file")


def generate_launch_description() -> LaunchDescription:
    """Nodes and arguments."""
    return LaunchDescription(
        [
            argument("twin_path", "", "twin file to use from the start; empty for none"),
            argument(
                "twin_params_file",
                str(share("egophys_twin", "config", "twin.yaml")),
                "parameters of twin_node: topics and options of the fit",
            ),
            *common_arguments(),
            *[check(lambda values, name=name: require_file(name, values[name])) for name in FILES],
            lifecycle_node(
                "egophys_twin", "twin_node", params_file="twin_params_file", parameters={"twin_path": text("twin_path")}
            ),
        ]
    )
