"""The planner, configured and activated; it asks the twin node for rollouts.

ros2 launch egophys_planner planner.launch.py
"""

from egophys_ros_common.launch_checks import require_file
from egophys_ros_common.launch_parts import argument, check, common_arguments, lifecycle_node, share
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Nodes and arguments."""
    return LaunchDescription(
        [
            argument(
                "planner_params_file",
                str(share("egophys_planner", "config", "planner.yaml")),
                "parameters of mppi_planner_node: names, timeouts and options of the planner",
            ),
            *common_arguments(),
            check(lambda values: require_file("planner_params_file", values["planner_params_file"])),
            lifecycle_node("egophys_planner", "mppi_planner_node", params_file="planner_params_file"),
        ]
    )
