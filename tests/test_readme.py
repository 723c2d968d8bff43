"""What the README tells people to type exists: subcommands and options, executables, launch arguments, types, files."""

import re
import shlex
from pathlib import Path

import pytest

from egophys_core.cli.main import make_parser

REPOSITORY = Path(__file__).resolve().parents[1]
README = (REPOSITORY / "README.md").read_text()
SOURCES = REPOSITORY / "ros2_ws/src"
BLOCKS = re.findall(r"^```\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
LINES = [line for block in BLOCKS for line in block.replace("\\\n", " ").splitlines()]


def commands(start: str) -> list[str]:
    found = [line.strip() for line in LINES if line.strip().startswith(start)]
    assert found, f"the README shows no {start}"
    return found


@pytest.mark.parametrize("command", commands("egophys "))
def test_subcommands_parse_as_written(command):
    words = shlex.split(command, comments=True)[1:]
    make_parser(words[0]).parse_args([word.replace("...", "") for word in words])


@pytest.mark.parametrize("command", commands("make "))
def test_make_targets_exist(command):
    target = shlex.split(command, comments=True)[1]
    assert re.search(rf"^{target}:", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)


@pytest.mark.parametrize("command", commands("ros2 run "))
def test_executables_and_their_parameters_exist(command):
    package, executable = command.split()[2:4]
    assert f"{executable} = " in (SOURCES / package / "setup.py").read_text()
    code = "".join(path.read_text() for path in SOURCES.rglob("*.py"))
    for name in re.findall(r"-p (\w+):=", command):
        assert f'"{name}"' in code, name
    for package, path in re.findall(r"prefix (\w+)\)/share/\w+/(\S+)", command):
        assert (SOURCES / package / path).exists(), path


@pytest.mark.parametrize("command", commands("ros2 launch "))
def test_launch_files_and_their_arguments_exist(command):
    package, file = command.split()[2:4]
    assert (SOURCES / package / "launch" / file).exists()
    code = "".join(path.read_text() for path in SOURCES.rglob("*.launch.py"))
    for name in re.findall(r"(\w+):=", command):
        assert f'"{name}"' in code, name


@pytest.mark.parametrize("name", sorted(set(re.findall(r"egophys_msgs/((?:msg|srv|action)/\w+)", README))))
def test_interfaces_exist(name):
    folder, message = name.split("/")
    assert (SOURCES / "egophys_msgs" / folder / f"{message}.{folder}").exists()


@pytest.mark.parametrize(
    "path", sorted(set(re.findall(r"`((?:egophys_core|ros2_ws|tests|docs|examples)/[\w./-]+)`", README)))
)
def test_places_exist(path):
    assert (REPOSITORY / path).exists()
