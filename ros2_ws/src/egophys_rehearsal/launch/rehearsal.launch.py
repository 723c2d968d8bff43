"""The rehearsal, configured and activated: a soft object that stands in for the lab.

ros2 launch egophys_rehearsal rehearsal.launch.py effects:=control_delay        # handled by the arm of the bridge
ros2 launch egophys_rehearsal rehearsal.launch.py object:=box hands:=lift       # by scripted hands
ros2 launch egophys_twin egophys.launch.py use_rehearsal:=true effects:=quadratic_drag log_folder:=PATH
"""

from egophys_ros_common.launch_checks import require_file
from egophys_ros_common.launch_parts import argument, check, common_arguments, lifecycle_node, share, text
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Nodes and arguments."""
    return LaunchDescription(
        [
            argument("object", "sheet", "what lies on the table", ("sheet", "ellipsoid", "box")),
            argument("hands", "arm", "who handles it: arm, or a scripted motion, for example lift"),
            argument("effects", "none", "names of the effects to inject, separated by spaces"),
            argument("effect_size", "large", "size of the effects", ("small", "large")),
            argument(
                "rehearsal_params_file",
                str(share("egophys_rehearsal", "config", "rehearsal.yaml")),
                "parameters of rehearsal_node",
            ),
            *common_arguments(),
            check(lambda values: require_file("rehearsal_params_file", values["rehearsal_params_file"])),
            lifecycle_node(
                "egophys_rehearsal",
                "rehearsal_node",
                params_file="rehearsal_params_file",
                parameters={name: text(name) for name in ("object", "hands", "effects", "effect_size")},
            ),
        ]
    )
