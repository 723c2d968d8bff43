"""`egophys rehearse`: bags and their truth, all or nothing."""

import argparse
import json

import numpy as np
import pytest

from egophys_core import rehearsal
from egophys_core.cli import rehearse as command
from egophys_core.errors import OptionsError, OutputError, SimulationError
from egophys_core.recording import read_episode

SHORT = ("--duration-s", "0.2", "--points", "30")


def run(*arguments: object) -> int:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return command.run(parser.parse_args([str(each) for each in arguments]))


def test_an_episode_a_motion_and_the_truth(tmp_path, capsys):
    out = tmp_path / "drag"
    effect = ("--effect", "quadratic_drag", "--parameter", "coefficient=13")
    assert run("--out", out, "--motions", "lift", "push", *effect, "--seed", 4, *SHORT, "--json") == 0
    truth = json.loads((out / "truth.json").read_text())
    assert json.loads(capsys.readouterr().out) == {"folder": str(out), **truth}
    assert sorted(each.name for each in out.iterdir()) == ["episode_0", "episode_1", "truth.json"]
    assert truth["effects"][0]["parameters"] == {"coefficient": {"value": 13.0, "unit": "1/m"}}
    assert [(each["motion"], each["seed"]) for each in truth["episodes"]] == [("lift", 4), ("push", 5)]
    episodes = [read_episode(out / each["folder"]) for each in truth["episodes"]]
    assert [each.frames for each in episodes] == [6, 6]
    assert not np.array_equal(episodes[0].controllers, episodes[1].controllers)
    assert [each.name for each in tmp_path.iterdir()] == ["drag"]


def test_no_effect_is_the_default(tmp_path, capsys):
    assert run("--out", tmp_path / "none", "--motions", "lift", *SHORT) == 0
    assert json.loads((tmp_path / "none/truth.json").read_text())["effects"] == []
    assert "1 episodes of a sheet with no effect written to" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--effect", "quadratic_drga"), "did you mean 'quadratic_drag'"),
        (("--effect", "grasp_slip", "--parameter", "onse=1"), "did you mean 'onset'"),
        (("--effect", "grasp_slip", "--parameter", "z=fast"), "'fast' is no number"),
        (("--parameter", "z=1"), "give EFFECT.NAME=VALUE with an effect of --effect, which are none"),
        (("--effect", "grasp_slip", "gravity_scale", "--parameter", "z=1"), "which are grasp_slip, gravity_scale"),
        (("--noise-m", "2"), "noise_m must be in 0 .. 0.05"),
    ],
)
def test_bad_requests_write_nothing(tmp_path, arguments, message):
    with pytest.raises(OptionsError) as raised:
        run("--out", tmp_path / "x", *arguments)
    assert message in str(raised.value)
    assert not list(tmp_path.iterdir())


def test_what_is_there_is_not_overwritten(tmp_path):
    with pytest.raises(OutputError, match="exists already"):
        run("--out", tmp_path)
    with pytest.raises(OutputError, match="create it first"):
        run("--out", tmp_path / "no" / "where")


def test_a_failure_on_the_way_leaves_nothing(tmp_path, monkeypatch):
    rehearse = rehearsal.rehearse

    def fail_second(options, motion, **rest):
        if motion == "pull":
            raise SimulationError("diverged")
        return rehearse(options, motion, **rest)

    monkeypatch.setattr(rehearsal, "rehearse", fail_second)
    with pytest.raises(SimulationError):
        run("--out", tmp_path / "x", "--motions", "lift", "pull", *SHORT)
    assert not list(tmp_path.iterdir())
