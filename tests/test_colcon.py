"""colcon.meta: colcon finds the build options of each package without being told, and they reach CMake."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
META = REPOSITORY / "colcon.meta"
PACKAGES = {path.parent.name for path in REPOSITORY.glob("ros2_ws/src/*/package.xml")}

MANIFEST = """<?xml version="1.0"?>
<package format="3">
  <name>egophys_msgs</name><version>0.0.0</version><description>Stands in for the messages.</description>
  <maintainer email="nobody@example.com">nobody</maintainer><license>MIT</license>
  <export><build_type>cmake</build_type></export>
</package>
"""
PROJECT = """cmake_minimum_required(VERSION 3.16)
project(egophys_msgs NONE)
option(BUILD_TESTING "As CTest has it" ON)
install(CODE "")
"""


def colcon(*arguments: str, folder: Path, log: Path) -> str:
    command = shutil.which("colcon")
    assert command, "no colcon on the path; source tools/ros_env.sh"
    done = subprocess.run(
        [command, "--log-base", log, *arguments], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_options_are_of_packages_that_there_are():
    names = json.loads(META.read_text())["names"]
    assert names
    assert set(names) <= PACKAGES


@pytest.mark.parametrize("folder", ["ros2_ws", "."])
def test_colcon_finds_them_in_the_workspace_and_at_the_root(tmp_path, folder):
    sources = "src" if folder == "ros2_ws" else "ros2_ws/src"
    told = colcon("info", "--base-paths", sources, folder=REPOSITORY / folder, log=tmp_path)
    assert set(told.split()) >= PACKAGES
    assert "-DBUILD_TESTING=OFF" in told


@pytest.mark.parametrize(("has_meta", "value"), [(True, "OFF"), (False, "ON")])
def test_they_reach_cmake(tmp_path, has_meta, value):
    source = tmp_path / "src/egophys_msgs"
    source.mkdir(parents=True)
    (source / "package.xml").write_text(MANIFEST)
    (source / "CMakeLists.txt").write_text(PROJECT)
    if has_meta:
        shutil.copy(META, tmp_path)
    colcon("build", folder=tmp_path, log=tmp_path / "log")
    assert f"BUILD_TESTING:BOOL={value}" in (tmp_path / "build/egophys_msgs/CMakeCache.txt").read_text()
