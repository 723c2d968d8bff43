"""A recorded episode and a twin built from it by the command itself."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from egophys_core.cli.main import main
from egophys_core.recording import write_episode
from tests.identification.synthetic import sheet_episode

FAST_FIT = ["--generations", "2", "--population", "4", "--frame-stride", "6", "--dense-steps", "1"]
FAST_PLAN = ["--iterations", "2", "--samples", "4", "--waypoints", "2", "--settle-s", "0.2"]


@pytest.fixture(scope="session")
def episode_bag(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "towel"
    write_episode(sheet_episode(), folder)
    return folder


@pytest.fixture(scope="session")
def twin_file(episode_bag, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("built") / "towel.twin"
    assert main(["build", str(episode_bag), "--out", str(path), *FAST_FIT]) == 0
    return path


@pytest.fixture
def egophys(capsys) -> Callable[..., tuple[int, str, str]]:
    """Runs the command; its exit code, standard output and standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        capsys.readouterr()
        try:
            code = main([str(each) for each in arguments])
        except SystemExit as stop:
            code = int(stop.code or 0)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture
def egophys_json(egophys) -> Callable[..., dict]:
    """Runs the command with --json; standard output must be one JSON object and nothing else."""

    def run(*arguments: object) -> dict:
        code, out, err = egophys(*arguments, "--json")
        assert code == 0, err
        content = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
        assert isinstance(content, dict)
        return content

    return run
