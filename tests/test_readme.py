"""What README and pages tell people to type exists and works: subcommands, executables, arguments, types, files."""

import re
import subprocess
import sys

import pytest

from egophys_core.cli.main import make_parser
from tests.documents import PAGES, REPOSITORY, all_commands, blocks, commands, run_egophys
from tests.perception.camera.films import write_film
from tests.perception.camera.lens_scene import board_film, board_poses, camera_of

SOURCES = REPOSITORY / "ros2_ws/src"
README = REPOSITORY / "README.md"
CHECKED = ("egophys", "make", "ros2", "source", "python")
"""What commands begin with; each has a test here."""

CAMERA = camera_of("plumb_bob", [-0.2, 0.05, 0.001, -0.0015, 0.0], 390, (480, 360))

FAST = {
    "perceive": ["--spacing", "9"],
    "build": ["--generations", "2", "--population", "4", "--frame-stride", "6", "--dense-steps", "0"],
    "plan": ["--iterations", "2", "--samples", "4", "--waypoints", "2"],
    "rehearse": ["--duration-s", "3", "--points", "60"],
    "diagnose": ["--baseline-starts", "1", "--shortlist", "1", "--surrogates", "20", "--bootstraps", "50"]
    + ["--refit-iterations", "2"],
}
"""Added to the README's commands when they are run, so that all of them take some minutes."""


def test_readme_is_short():
    assert len(README.read_text().splitlines()) <= 200


def test_every_command_is_of_a_kind_that_is_checked():
    odd = [each for page in PAGES for each in commands(page) if each.words[0] not in CHECKED]
    assert not odd


@pytest.mark.parametrize("command", all_commands("egophys "), ids=lambda each: f"{each.page}: {each.text}")
def test_subcommands_parse_as_written(command):
    words = [word.replace("...", "") for word in command.words[1:]]
    make_parser(words[0]).parse_args(words)


@pytest.mark.parametrize("command", all_commands("make "), ids=lambda each: each.text)
def test_make_targets_can_be_made(command):
    done = subprocess.run(
        ["make", "--dry-run", *command.words[1:]],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", all_commands("source "), ids=lambda each: each.text)
def test_sourced_files_are_there_or_made(command):
    path = command.words[1]
    assert path.startswith(("/opt/ros/", "ros2_ws/install/")) or (REPOSITORY / path).exists()


@pytest.mark.parametrize("command", all_commands("ros2 run "), ids=lambda each: each.text)
def test_executables_and_their_parameters_exist(command):
    package, executable = command.text.split()[2:4]
    assert f"{executable} = " in (SOURCES / package / "setup.py").read_text()
    code = "".join(path.read_text() for path in SOURCES.rglob("*.py"))
    for name in re.findall(r"-p (\w+):=", command.text):
        assert f'"{name}"' in code, name
    for package, path in re.findall(r"prefix (\w+)\)/share/\w+/(\S+)", command.text):
        assert (SOURCES / package / path).exists(), path


@pytest.mark.parametrize("command", all_commands("ros2 launch "), ids=lambda each: each.text)
def test_launch_files_and_their_arguments_exist(command):
    package, file = command.text.split()[2:4]
    assert (SOURCES / package / "launch" / file).exists()
    code = "".join(path.read_text() for path in SOURCES.rglob("*.launch.py"))
    for name in re.findall(r"(\w+):=", command.text):
        assert f'"{name}"' in code, name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_interfaces_exist(page):
    for folder, message in set(re.findall(r"egophys_msgs/(msg|srv|action)/(\w+)", page.read_text())):
        assert (SOURCES / "egophys_msgs" / folder / f"{message}.{folder}").exists(), message


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_places_exist(page):
    text = page.read_text()
    rooms = r"`((?:egophys_core|ros2_ws|tests|docs|examples|benchmarks|tools)/[\w./-]+)`"
    missing = [path for path in set(re.findall(rooms, text)) if not (REPOSITORY / path).exists()]
    links = [link for link in set(re.findall(r"\]\(([\w./-]+)\)", text)) if not (page.parent / link).exists()]
    assert not missing + links


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_python_blocks_import_what_there_is(page):
    for block in blocks(page, "python"):
        imports = [line for line in block.splitlines() if line.startswith(("from ", "import "))]
        exec("\n".join(imports), {})


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "examples").symlink_to(REPOSITORY / "examples")
    # The films of the reader: one of the printed board stands for both.
    images = list(board_film(CAMERA, board_poses(16, tilt=40, distance=0.5), blur=0.5))
    for name in ("board_film.mp4", "towel.mp4"):
        write_film(tmp_path / name, images)
    return tmp_path


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_blocks_of_the_readme_run_one_after_the_other(folder):
    pytest.importorskip("mujoco", reason="needs the extra [rehearsal]")
    for command in commands(README):
        if command.words[0] == "egophys":
            name = command.words[1]
            run_egophys([*command.words, *FAST.get(name, ())], folder, good=(0, 1) if name == "diagnose" else (0,))
    made = {path.name for path in folder.iterdir()}
    assert made >= {"board.pdf", "seen", "towel.twin", "plan.json", "diagnosis", "next", "asked"}


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_picture_of_the_readme_can_be_made_again(tmp_path):
    assert "python examples/picture.py" in README.read_text()
    out = tmp_path / "twin.jpg"
    command = [sys.executable, "examples/picture.py", "--out", str(out), "--generations", "2"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=1500, check=False)
    assert done.returncode == 0, done.stderr
    assert out.read_bytes().startswith(b"\xff\xd8")
