"""`egophys rehearse`: bags and their truth, all or nothing."""

import argparse
import json
from dataclasses import replace

import numpy as np
import pytest

from egophys_core import rehearsal
from egophys_core.cli import rehearse as command
from egophys_core.errors import OptionsError, OutputError, PlanningError, SimulationError
from egophys_core.experiments.hand_path import PathWriter, plan_of_path
from egophys_core.plan_file import PlanFile, read_plan, write_plan
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
    assert "1 episode of a sheet with no effect written to" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--effect", "quadratic_drga"), "did you mean 'quadratic_drag'"),
        (("--effect", "grasp_slip", "--parameter", "onse=1"), "did you mean 'onset'"),
        (("--effect", "grasp_slip", "--parameter", "z=fast"), "'fast' is no number"),
        (("--parameter", "z=1"), "give EFFECT.NAME=VALUE with an effect of --effect, which are none"),
        (("--effect", "grasp_slip", "gravity_scale", "--parameter", "z=1"), "which are grasp_slip, gravity_scale"),
        (("--noise-m", "2"), "noise_m must be in 0 .. 0.05"),
        (
            ("--points", "3", "--dropout", "0.9"),
            "none of the 3 points is seen in the first frame: raise points or lower",
        ),
    ],
)
def test_bad_requests_write_nothing(tmp_path, arguments, message):
    with pytest.raises(OptionsError) as raised:
        run("--out", tmp_path / "x", *arguments)
    assert message in str(raised.value)
    assert not list(tmp_path.iterdir())


def write_hand(path, *, holds=True, x=0.0):
    """The plan of a hand that takes what lies at the edge of the table's middle and lifts it a little."""
    writer = PathWriter(np.array([x, -0.08, 0.01]))
    writer.move([0.0, 0.0, 0.05], peak_speed=0.5)
    found = writer.path()
    plan = plan_of_path(replace(found, holds=found.holds & holds), "")
    write_plan(path, PlanFile(plan=plan, stamp_ns=1, tolerance=float("nan")))
    return path


def test_hands_do_as_plans_say(tmp_path, capsys):
    plans = [write_hand(tmp_path / f"hand_{number}.json", x=x) for number, x in enumerate((-0.08, 0.08))]
    assert run("--out", tmp_path / "x", "--plan", *plans, "--points", 30) == 0
    assert "1 episode of a sheet" in capsys.readouterr().out
    about = json.loads((tmp_path / "x/truth.json").read_text())["episodes"]
    assert about == [{"folder": "x", "motion": "plan", "plans": ["hand_0.json", "hand_1.json"], "seed": 0}]
    episode = read_episode(tmp_path / "x/x")
    duration = read_plan(plans[0]).plan.times[-1]
    assert episode.times[-1] == pytest.approx(duration, abs=0.1)
    heights = episode.controllers[:, :, 2].mean(axis=1)
    assert heights[-1] == pytest.approx(0.06, abs=0.005)
    assert np.nanmax(episode.points[-1, :, 2]) > np.nanmax(episode.points[0, :, 2]) + 0.03


def test_plans_that_do_not_fit_together_are_refused(tmp_path):
    never = write_hand(tmp_path / "never.json", holds=False)
    with pytest.raises(PlanningError, match="must close once"):
        run("--out", tmp_path / "x", "--plan", never, *SHORT)
    with pytest.raises(PlanningError, match="must have the same times and close together"):
        run("--out", tmp_path / "x", "--plan", never, write_hand(tmp_path / "closes.json"), *SHORT)
    for several in ([never, never], [never, tmp_path / "b", tmp_path / "c"]):
        with pytest.raises(OptionsError, match="a file a hand, at most 2 different ones"):
            run("--out", tmp_path / "x", "--plan", *several, *SHORT)
    assert not (tmp_path / "x").exists()


def test_what_is_there_is_not_overwritten(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="the folder is not empty"):
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
