"""The observer of the live camera, configured and activated.

ros2 launch egophys_twin observer.launch.py
ros2 launch egophys_twin observer.launch.py image_topic:=/camera/image_raw image_transport:=raw
"""

from egophys_ros_common.launch_checks import require_file
from egophys_ros_common.launch_parts import argument, check, common_arguments, lifecycle_node, share, text
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Nodes and arguments."""
    return LaunchDescription(
        [
            argument("image_topic", "/ego/image_raw/compressed", "topic of the camera's images"),
            argument("image_transport", "compressed", "how the camera sends its images", ("compressed", "raw")),
            argument("camera_info_topic", "/ego/camera_info", "topic of the camera's calibration"),
            argument(
                "observer_params_file",
                str(share("egophys_twin", "config", "observer.yaml")),
                "parameters of observer_node: topics, options of perception, the board",
            ),
            *common_arguments(),
            check(lambda values: require_file("observer_params_file", values["observer_params_file"])),
            lifecycle_node(
                "egophys_twin",
                "observer_node",
                params_file="observer_params_file",
                parameters={name: text(name) for name in ("image_topic", "image_transport", "camera_info_topic")},
            ),
        ]
    )
