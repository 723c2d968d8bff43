"""`egophys experiment`: what it asks about, and what it leaves on disk."""

import argparse
import json

import pytest

from egophys_core.cli import experiment as command
from egophys_core.diagnosis.diagnosis import Outcome, save_diagnosis
from egophys_core.errors import DiscrepancyError, OptionsError, OutputError, TwinError
from egophys_core.experiments import choice
from egophys_core.plan_file import read_plan
from egophys_core.twin import save_twin
from tests.diagnosis.findings import make_diagnosis
from tests.effects.situations import sheet
from tests.experiments.twins import twin_of


@pytest.fixture
def twin_file(tmp_path):
    save_twin(twin_of(sheet()), tmp_path / "sheet.twin")
    return tmp_path / "sheet.twin"


@pytest.fixture
def only_hanging(monkeypatch):
    """Of the family what hangs still alone, so that it takes seconds."""
    family = choice.motions_for
    monkeypatch.setattr(
        choice, "motions_for", lambda *args, **rest: [each for each in family(*args, **rest) if "still" in each.name]
    )


def run(*arguments: object) -> int:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return command.run(parser.parse_args([str(each) for each in arguments]))


def test_plans_a_picture_and_what_is_expected(twin_file, tmp_path, capsys, only_hanging):
    assert run(twin_file, "--effects", "quadratic_drag", "gravity_scale", "--out", tmp_path / "x") == 0
    said = capsys.readouterr().out
    content = json.loads((tmp_path / "x/experiment.json").read_text())
    motion = content["motions"][0]
    assert motion["sentence"] in " ".join(said.split())
    assert {each["effect"] for each in motion["limits_after"]} == {"quadratic_drag", "gravity_scale"}
    assert (tmp_path / "x" / motion["picture"]).read_bytes().startswith(b"\x89PNG")
    plans = [read_plan(tmp_path / "x" / each).plan for each in motion["plans"]]
    assert {plan.twin_id for plan in plans} == {content["twin_id"]}
    assert plans[0].times[-1] == pytest.approx(motion["seconds"])


def test_an_arm_does_it_with_one_hand(twin_file, tmp_path, capsys, only_hanging):
    assert run(twin_file, "--effects", "gravity_scale", "--by", "arm", "--out", tmp_path / "x", "--json") == 0
    assert [len(each["plans"]) for each in json.loads(capsys.readouterr().out)["motions"]] == [1]


def test_what_a_diagnosis_left_open_is_asked_about(twin_file, tmp_path, capsys, only_hanging):
    found = make_diagnosis(
        outcome=Outcome.AMBIGUOUS,
        effects=tuple(
            type(make_diagnosis().effects[0])(name=name, parameters={}, episodes_agree=True)
            for name in ("gravity_scale", "added_mass")
        ),
        ambiguous=("gravity_scale", "added_mass"),
    )
    (tmp_path / "d").mkdir()
    save_diagnosis(found, tmp_path / "d/diagnosis.json")
    assert run(twin_file, "--diagnosis", tmp_path / "d", "--out", tmp_path / "x", "--json") == 0
    limits = json.loads(capsys.readouterr().out)["motions"][0]
    assert {each["effect"] for each in limits["limits_after"]} == {"gravity_scale", "added_mass"}
    assert {each["effect"] for each in limits["limits_before"]} == {"quadratic_drag", "control_delay"}


def test_bad_requests_write_nothing(twin_file, tmp_path):
    with pytest.raises(TwinError, match="did you mean quadratic_drag"):
        run(twin_file, "--effects", "quadratic_drga", "--out", tmp_path / "x")
    with pytest.raises(DiscrepancyError, match="give the folder that `egophys diagnose` made"):
        run(twin_file, "--diagnosis", tmp_path / "no", "--out", tmp_path / "x")
    (tmp_path / "old").mkdir()
    (tmp_path / "old/diagnosis.json").write_text("[" * 100_000)
    with pytest.raises(DiscrepancyError, match="give the folder that `egophys diagnose` made"):
        run(twin_file, "--diagnosis", tmp_path / "old", "--out", tmp_path / "x")
    nothing_open = {**make_diagnosis().as_dict(), "candidates": []}
    (tmp_path / "old/diagnosis.json").write_text(json.dumps(nothing_open))
    with pytest.raises(OptionsError, match="leaves no effect open; name some with --effects"):
        run(twin_file, "--diagnosis", tmp_path / "old", "--out", tmp_path / "x")
    with pytest.raises(OutputError, match="is not empty"):
        run(twin_file, "--out", tmp_path / "old")
    assert not (tmp_path / "x").exists()
