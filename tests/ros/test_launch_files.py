"""Launch files and parameter files: against `launch` where a ROS is sourced, and as far as possible without."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.episode_source import SourceOptions
from egophys_core.identification import FitOptions
from egophys_core.options import from_mapping, to_mapping
from egophys_core.perception.camera.board import Board
from egophys_core.perception.options import PerceptionOptions
from egophys_core.planning import PlanOptions
from egophys_core.rehearsal import RehearsalOptions
from egophys_core.robot import MotionLimits
from tests.ros import launch_stand_in
from tests.ros.launch_stand_in import PythonLaunchDescriptionSource

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws/src"
EGOPHYS = SOURCES / "egophys_twin/launch/egophys.launch.py"
LAUNCH_FILES = sorted(SOURCES.glob("*/launch/*.launch.py"))
PARAMETER_FILES = sorted(set(SOURCES.glob("*/config/*.yaml")) - {SOURCES / "xarm_bridge/config/world_to_base.yaml"})
EXECUTABLES = {
    "egophys_twin": {"twin_node", "observer_node", "recorder_node"},
    "egophys_planner": {"mppi_planner_node"},
    "egophys_rehearsal": {"rehearsal_node"},
    "xarm_bridge": {"bridge_node", "emulator"},
}


@pytest.fixture
def entities(monkeypatch):
    """`entities(file)`: what a launch file makes, in its order."""
    launch_stand_in.install(monkeypatch)
    return lambda file: PythonLaunchDescriptionSource(str(file)).get_launch_description(None).entities


def kinds(found, *names):
    return [each for each in found if type(each).__name__ in names]


def values_of(found, **given):
    """The arguments' values, as launch has them."""
    defaults = {each.name: each.named["default_value"] for each in kinds(found, "DeclareLaunchArgument")}
    return defaults | given


def run_checks(found, values):
    """What launch does with the checks of the arguments."""
    for each in kinds(found, "OpaqueFunction"):
        each.named["function"](SimpleNamespace(launch_configurations=values))


def test_there_are_launch_files():
    assert {path.name for path in LAUNCH_FILES} >= {
        "twin.launch.py",
        "planner.launch.py",
        "observer.launch.py",
        "rehearsal.launch.py",
        "egophys.launch.py",
    }


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_what_a_launch_file_starts_exists_and_does_not_end_unnoticed(entities, path):
    found = entities(path)
    arguments = kinds(found, "DeclareLaunchArgument")
    assert {"namespace", "log_level", "respawn"} <= {each.name for each in arguments}
    for each in arguments:
        assert each.named["description"]
        choices, default = each.named["choices"], each.named["default_value"]
        assert default in choices if choices else default not in ("true", "false")
    nodes = kinds(found, "Node")
    for node in (each.named for each in nodes if each.named["package"] in EXECUTABLES):
        assert node["executable"] in EXECUTABLES[node["package"]]
        ends_launch = type(node["on_exit"]).__name__ == "Shutdown"
        assert ends_launch == (node["executable"] in ("recorder_node", "bridge_node", "emulator"))
        assert ends_launch != ("respawn" in node)
        if node["executable"] != "emulator":
            assert node["name"] == node["executable"]
            assert node["namespace"].positional == ("namespace",)
            assert node["parameters"][1]["autostart"] is True
    first = min(found.index(each) for each in kinds(found, "Node", "IncludeLaunchDescription"))
    checks = kinds(found, "DeclareLaunchArgument", "OpaqueFunction")
    assert all(found.index(each) < first for each in checks), "nothing starts before all arguments are checked"
    run_checks(found, values_of(found))


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"log_folder": "."}, "log_folder: .* exists already"),
        ({"log_folder": "/dev/null/log"}, "log_folder: /dev/null/log cannot be made"),
        ({"robot_ip": "192.168.1.200"}, "give use_emulator:=false too"),
        ({"robot_ip": "localhost"}, "an address as 127.0.0.1"),
        ({"use_emulater": "false"}, "no argument use_emulater; did you mean use_emulator?"),
        ({"twin_path": "/no/such.twin"}, "twin_path: there is no file /no/such.twin"),
        ({"planner_params_file": "absent.yaml"}, "planner_params_file: there is no file .*/absent.yaml"),
        ({"use_rviz": "true"}, "RViz is not installed here"),
    ],
)
def test_arguments_that_cannot_be_are_one_error_before_anything_starts(entities, given, reason):
    found = entities(EGOPHYS)
    with pytest.raises(RuntimeError, match=reason):
        run_checks(found, values_of(found, **given))


def test_a_launch_may_have_a_real_arm_and_arguments_of_others(entities, tmp_path):
    found = entities(EGOPHYS)
    given = {"use_emulator": "false", "robot_ip": "192.168.1.200", "log_folder": str(tmp_path / "a/log"), "speed": "1"}
    run_checks(found, values_of(found, **given))


@pytest.mark.parametrize(("code", "ends"), [(1, True), (2, True), (0, False), (70, False), (-9, False)])
def test_a_node_that_cannot_start_ends_the_launch_and_one_that_crashed_comes_back(monkeypatch, code, ends):
    parts = launch_stand_in.install(monkeypatch)
    node = parts.lifecycle_node("egophys_twin", "twin_node", params_file="twin_params_file")
    answer = node.named["on_exit"](SimpleNamespace(returncode=code, process_name="twin_node-1"), None)
    assert bool(answer) == ends


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_loads_it(path):
    launch = pytest.importorskip("launch", reason="launch is not on PyPI; source a ROS to run this")
    sources = pytest.importorskip("launch.launch_description_sources")
    source = sources.PythonLaunchDescriptionSource(str(path))
    arguments = source.get_launch_description(launch.LaunchContext()).get_launch_arguments()
    assert arguments
    assert all(argument.description for argument in arguments)


@pytest.mark.parametrize(
    ("file", "group", "options"),
    [
        ("egophys_twin/config/twin.yaml", "", FitOptions),
        ("egophys_twin/config/twin.yaml", "diagnosis", DiagnosisOptions),
        ("egophys_twin/config/twin.yaml", "", SourceOptions),
        ("egophys_twin/config/twin.yaml", "perception", PerceptionOptions),
        ("egophys_twin/config/twin.yaml", "board", Board),
        ("egophys_twin/config/observer.yaml", "perception", PerceptionOptions),
        ("egophys_twin/config/observer.yaml", "board", Board),
        ("xarm_bridge/config/bridge.yaml", "", MotionLimits),
        ("egophys_planner/config/planner.yaml", "", PlanOptions),
        ("egophys_rehearsal/config/rehearsal.yaml", "", RehearsalOptions),
    ],
)
def test_parameter_files_list_every_option_with_its_default(file, group, options):
    values = parameters_of(file)
    values = values[group] if group else values
    names = {field.name for field in dataclasses.fields(options)}
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
    chosen = from_mapping(options, {name: value for name, value in given.items() if name in names})
    assert names <= set(values)
    assert to_mapping(chosen) == to_mapping(options())
    assert not group or set(values) == names


def parameters_of(file):
    """Of a node of any name in any namespace, for rclpy knows no other pattern than this key."""
    (key, content), *others = yaml.safe_load((SOURCES / file).read_text()).items()
    assert (key, others) == ("/**", [])
    return content["ros__parameters"]


def test_the_recorder_logs_what_replay_and_diagnosis_need_and_why_something_was_refused():
    topics = set(parameters_of("egophys_twin/config/recorder.yaml")["topics"])
    assert topics >= {
        *(f"twin_node/{name}" for name in ("model", "training/build", "predicted/plan", "predicted/points")),
        *(f"twin_node/training/{name}_points" for name in ("object", "controller")),
        *(f"mppi_planner_node/{name}" for name in ("problem", "target", "plan")),
        "/rosout",
    }
    twin = parameters_of("egophys_twin/config/twin.yaml")
    assert topics >= {twin[name] for name in ("object_topic", "controller_topic", "executed_topic")}


@pytest.mark.parametrize("file", PARAMETER_FILES, ids=lambda path: path.name)
def test_parameter_files_work_in_a_namespace(file):
    names = [value for name, value in parameters_of(file).items() if name.endswith(("_topic", "_service"))]
    assert all(not name.startswith("/") or name.startswith("/ego/") for name in names)
