"""All nodes, configured and activated: twin, planner, bridge with emulator; the recorder if told where to, the
observer if there is a camera, the rehearsal if there is no object.

The launch ends when the recorder, the bridge or the emulator does; the other nodes are started again after a crash.

ros2 launch egophys_twin egophys.launch.py log_folder:=PATH
ros2 launch egophys_twin egophys.launch.py use_emulator:=false robot_ip:=192.168.1.200 calibration_file:=PATH
ros2 launch egophys_twin egophys.launch.py use_observer:=true use_rviz:=true
ros2 launch egophys_twin egophys.launch.py use_rehearsal:=true effects:=control_delay log_folder:=PATH
ros2 launch egophys_twin egophys.launch.py namespace:=lab robot_ip:=127.0.0.2   # beside another one
ros2 launch egophys_twin egophys.launch.py --show-args   # those of the included launch files too
"""

from collections.abc import Mapping

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from egophys_ros_common.launch_checks import ArgumentError, require_file, require_new_folder, require_no_misspelling
from egophys_ros_common.launch_parts import (
    argument,
    arguments_and_checks,
    check,
    common_arguments,
    launch_file,
    lifecycle_node,
    share,
    switch,
    text,
)
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node

INCLUDED = (
    ("egophys_twin", "twin.launch.py", ""),
    ("egophys_planner", "planner.launch.py", ""),
    ("xarm_bridge", "bridge.launch.py", "use_bridge"),
    ("egophys_twin", "observer.launch.py", "use_observer"),
    ("egophys_rehearsal", "rehearsal.launch.py", "use_rehearsal"),
)
"""Packages, their launch files, and the argument that says whether it is included."""


def generate_launch_description() -> LaunchDescription:
    """Nodes and arguments."""
    own = [
        argument("log_folder", "", "rosbag2 folder to record to, must not exist; empty to record nothing"),
        argument(
            "recorder_params_file",
            str(share("egophys_twin", "config", "recorder.yaml")),
            "parameters of recorder_node: the topics",
        ),
        switch("use_bridge", "true", "start the bridge to the arm, or to the emulator"),
        switch("use_observer", "false", "start the observer of the live camera"),
        switch("use_rehearsal", "false", "start the rehearsal, a simulated object that the arm handles"),
        switch("use_rviz", "false", "start RViz with a view of camera, points, twin, plan and arm"),
        *common_arguments(),
    ]
    sources = [launch_file(package, name) for package, name, _ in INCLUDED]
    theirs = arguments_and_checks(sources)
    known = [each.name for each in (*own, *theirs) if isinstance(each, DeclareLaunchArgument)]
    return LaunchDescription(
        [
            *own,
            check(lambda values: require_no_misspelling(values, known)),
            check(_check),
            *theirs,
            lifecycle_node(
                "egophys_twin",
                "recorder_node",
                params_file="recorder_params_file",
                parameters={"output_folder": text("log_folder")},
                ends_launch="nothing is recorded any more",
                condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration("log_folder"), "")),
            ),
            *[
                IncludeLaunchDescription(source, condition=IfCondition(LaunchConfiguration(name)) if name else None)
                for source, (_, _, name) in zip(sources, INCLUDED, strict=True)
            ],
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=LaunchConfiguration("namespace"),
                arguments=["-d", str(share("egophys_twin", "rviz", "egophys.rviz"))],
                condition=IfCondition(LaunchConfiguration("use_rviz")),
                output="screen",
            ),
        ]
    )


def _check(values: Mapping[str, str]) -> None:
    require_new_folder("log_folder", values["log_folder"])
    require_file("recorder_params_file", values["recorder_params_file"])
    if values["use_rviz"] == "true":
        try:
            get_package_prefix("rviz2")
        except PackageNotFoundError as error:
            raise ArgumentError("use_rviz: RViz is not installed here; apt install ros-jazzy-rviz2") from error
