"""Launch files and parameter files: against `launch` where a ROS is sourced, and as far as possible without."""

import ast
import dataclasses
from pathlib import Path

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

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws/src"
LAUNCH_FILES = sorted(SOURCES.glob("*/launch/*.launch.py"))
EXECUTABLES = {
    "egophys_twin": {"twin_node", "observer_node", "recorder_node"},
    "egophys_planner": {"mppi_planner_node"},
    "egophys_rehearsal": {"rehearsal_node"},
    "xarm_bridge": {"bridge_node", "emulator"},
}


def calls(tree, function):
    """Keyword arguments, as source, of the calls of a function."""
    return [
        {word.arg: ast.unparse(word.value).strip("'") for word in node.keywords if word.arg}
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == function
    ]


def test_there_are_launch_files():
    assert {path.name for path in LAUNCH_FILES} >= {
        "twin.launch.py",
        "planner.launch.py",
        "observer.launch.py",
        "rehearsal.launch.py",
        "egophys.launch.py",
    }


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_what_a_launch_file_starts_exists(path):
    tree = ast.parse(path.read_text())
    compile(tree, path, "exec")
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert "generate_launch_description" in functions
    for node in calls(tree, "Node"):
        assert node["executable"] in EXECUTABLES[node["package"]]
    for package, file in (
        tuple(ast.literal_eval(each) for each in node.args[:2])
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "_include"
    ):
        assert (SOURCES / package / "launch" / file).is_file()


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_loads_it(path):
    launch = pytest.importorskip("launch", reason="launch is not on PyPI; source a ROS to run this")
    sources = pytest.importorskip("launch.launch_description_sources")
    source = sources.PythonLaunchDescriptionSource(str(path))
    arguments = source.get_launch_description(launch.LaunchContext()).get_launch_arguments()
    assert arguments
    assert all(argument.description for argument in arguments)


@pytest.mark.parametrize(
    ("file", "node", "group", "options"),
    [
        ("egophys_twin/config/twin.yaml", "twin_node", "", FitOptions),
        ("egophys_twin/config/twin.yaml", "twin_node", "diagnosis", DiagnosisOptions),
        ("egophys_twin/config/twin.yaml", "twin_node", "", SourceOptions),
        ("egophys_twin/config/twin.yaml", "twin_node", "perception", PerceptionOptions),
        ("egophys_twin/config/twin.yaml", "twin_node", "board", Board),
        ("egophys_twin/config/observer.yaml", "observer_node", "perception", PerceptionOptions),
        ("egophys_twin/config/observer.yaml", "observer_node", "board", Board),
        ("egophys_planner/config/planner.yaml", "mppi_planner_node", "", PlanOptions),
        ("egophys_rehearsal/config/rehearsal.yaml", "rehearsal_node", "", RehearsalOptions),
    ],
)
def test_parameter_files_list_every_option_with_its_default(file, node, group, options):
    values = yaml.safe_load((SOURCES / file).read_text())["/**"]["ros__parameters"]
    values = values[group] if group else values
    names = {field.name for field in dataclasses.fields(options)}
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
    chosen = from_mapping(options, {name: value for name, value in given.items() if name in names})
    assert names <= set(values)
    assert to_mapping(chosen) == to_mapping(options())
    assert not group or set(values) == names


def test_the_recorder_logs_what_replay_needs():
    topics = yaml.safe_load((SOURCES / "egophys_twin/config/recorder.yaml").read_text())
    topics = set(topics["/**"]["ros__parameters"]["topics"])
    assert topics >= {
        *(f"twin_node/{name}" for name in ("model", "training/build", "predicted/plan", "predicted/points")),
        *(f"twin_node/training/{name}_points" for name in ("object", "controller")),
        *(f"mppi_planner_node/{name}" for name in ("problem", "target", "plan")),
    }


def test_the_recorder_logs_what_a_diagnosis_needs():
    topics = yaml.safe_load((SOURCES / "egophys_twin/config/recorder.yaml").read_text())
    twin = yaml.safe_load((SOURCES / "egophys_twin/config/twin.yaml").read_text())["/**"]["ros__parameters"]
    logged = set(topics["/**"]["ros__parameters"]["topics"])
    assert logged >= {twin[name] for name in ("object_topic", "controller_topic", "executed_topic")}
