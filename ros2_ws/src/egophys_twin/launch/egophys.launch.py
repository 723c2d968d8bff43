"""All nodes, configured and activated: twin, planner, bridge with emulator; the recorder if told where to, the
observer if there is a camera, the rehearsal if there is no object.

ros2 launch egophys_twin egophys.launch.py log_folder:=PATH
ros2 launch egophys_twin egophys.launch.py use_emulator:=false robot_ip:=192.168.1.200 calibration_file:=PATH
ros2 launch egophys_twin egophys.launch.py use_observer:=true
ros2 launch egophys_twin egophys.launch.py use_rehearsal:=true effects:=control_delay log_folder:=PATH
ros2 launch egophys_twin egophys.launch.py --show-args   # those of the included launch files too
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    config = Path(get_package_share_directory("egophys_twin")) / "config"
    arguments = {
        "log_folder": ("", "rosbag2 folder to record to, must not exist; empty to record nothing"),
        "recorder_params_file": (str(config / "recorder.yaml"), "parameters of recorder_node: the topics"),
        "use_bridge": ("true", "start the bridge to the arm, or to the emulator"),
        "use_observer": ("false", "start the observer of the live camera"),
        "use_rehearsal": ("false", "start the rehearsal, a simulated object that the arm handles"),
    }
    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in arguments.items()
            ],
            Node(
                package="egophys_twin",
                executable="recorder_node",
                name="recorder_node",
                condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration("log_folder"), "")),
                parameters=[
                    LaunchConfiguration("recorder_params_file"),
                    {
                        "output_folder": ParameterValue(LaunchConfiguration("log_folder"), value_type=str),
                        "autostart": True,
                    },
                ],
                output="screen",
            ),
            _include("egophys_twin", "twin.launch.py"),
            _include("egophys_planner", "planner.launch.py"),
            _include("xarm_bridge", "bridge.launch.py", IfCondition(LaunchConfiguration("use_bridge"))),
            _include("egophys_twin", "observer.launch.py", IfCondition(LaunchConfiguration("use_observer"))),
            _include("egophys_rehearsal", "rehearsal.launch.py", IfCondition(LaunchConfiguration("use_rehearsal"))),
        ]
    )


def _include(package: str, file: str, condition: IfCondition | None = None) -> IncludeLaunchDescription:
    path = Path(get_package_share_directory(package)) / "launch" / file
    return IncludeLaunchDescription(PythonLaunchDescriptionSource(str(path)), condition=condition)
