"""`egophys diagnose`: what it prints and its exit code; bad input is refused before any physics."""

import argparse
import json
import os

import pytest

from egophys_core.cli import diagnose as command
from egophys_core.diagnosis.diagnose import Finding
from egophys_core.errors import EgophysError, OptionsError, OutputError, RecordingError, TwinError
from egophys_core.recording import write_episode
from egophys_core.twin import load_twin, save_twin
from tests.diagnosis.findings import make_diagnosis, make_evidence, make_nothing_found
from tests.identification.synthetic import sheet_episode
from tests.twin.examples import make_twin


def run(*arguments: object) -> int:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return command.run(parser.parse_args([str(each) for each in arguments]))


@pytest.fixture
def asked(monkeypatch) -> list[dict]:
    """What the diagnosis was asked, in place of the minutes it takes; it answers with a finding made by hand."""
    calls: list[dict] = []

    def answer(twin, episodes, options, **more):
        calls.append({"twin": twin, "episodes": episodes, "options": options, **more})
        more["progress"]("probe", 0.5)
        return Finding(
            diagnosis=make_diagnosis() if more["seed"] else make_nothing_found(),
            twin=make_twin(),
            before=make_twin().model,
            evidence=make_evidence(),
            searches=(),
        )

    monkeypatch.setattr("egophys_core.experiments.asking.diagnose", answer)
    return calls


@pytest.fixture
def twin(tmp_path):
    save_twin(make_twin(), tmp_path / "towel.twin")
    return tmp_path / "towel.twin"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "lift"
    write_episode(sheet_episode(), folder)
    return folder


def test_a_finding_is_summed_up_and_saved(asked, twin, bag, tmp_path, capsys):
    arguments = ("--report-on", bag, "--without", "anisotropy", "plasticity", "--seed", 3, "--shortlist", 2)
    assert run(twin, bag, "--out", tmp_path / "found", *arguments) == 1
    assert sorted(os.listdir(tmp_path / "found")) == ["diagnosis.json", "improved.twin", "report.html"]
    assert load_twin(tmp_path / "found" / "improved.twin").twin_id == make_twin().twin_id
    (call,) = asked
    assert [each.name for each in (*call["episodes"], *call["report_on"])] == ["lift", "lift"]
    assert (call["without"], call["seed"]) == (["anisotropy", "plasticity"], 3)
    assert call["options"].shortlist == 2
    out = capsys.readouterr().out
    assert out.startswith("named: The twin lacks one thing: air drag")
    for part in ("gains 406", "episodes agree", "2.75 .. 4.6", "swing (new)", "12.0", "report.html"):
        assert part in out
    assert "egophys experiment" not in out


def test_a_load_reaches_the_diagnosis(asked, twin, bag, tmp_path):
    run(twin, bag, "--load", "lift=0.5", "--out", tmp_path / "found")
    assert asked[0]["loads"] == {"lift": 0.5}


def test_no_effect_is_exit_code_0_and_says_how_to_see_more(asked, twin, bag, tmp_path, capsys):
    assert run(twin, bag, "--out", tmp_path / "found") == 0
    out = capsys.readouterr().out
    assert f"egophys experiment {tmp_path / 'found' / 'improved.twin'} --diagnosis {tmp_path / 'found'} --out" in out
    assert out.startswith("none: No effect found")
    assert out.count("nearest miss: ") == 2
    missed = "held-out gain by slopes: 4.1, needs at least 8.33 for a refit"
    for part in (
        f"decided: No candidate passes all criteria. Decided by quadratic_drag: {missed}",
        f"bending_damping: {missed}",
    ):
        assert part in " ".join(out.split())


def test_json_is_the_content_of_the_file(asked, twin, bag, tmp_path, capsys):
    assert run(twin, bag, "--out", tmp_path / "found", "--json", "--seed", 1) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "found" / "diagnosis.json").read_text())


def refused(kind: type[EgophysError], tmp_path, *arguments: object) -> str:
    there = sorted(os.listdir(tmp_path))
    with pytest.raises(kind) as caught:
        run(*arguments)
    assert sorted(os.listdir(tmp_path)) == there
    return str(caught.value)


def test_bad_input_is_refused_before_the_diagnosis(asked, twin, bag, tmp_path):
    out = ("--out", tmp_path / "found")
    (tmp_path / "file").write_text("mine")
    assert "no.twin" in refused(TwinError, tmp_path, tmp_path / "no.twin", bag, *out)
    assert "not a twin" in refused(TwinError, tmp_path, tmp_path / "file", bag, *out)
    assert "no.mcap" in refused(RecordingError, tmp_path, twin, tmp_path / "no.mcap", *out)
    assert "no.mcap" in refused(RecordingError, tmp_path, twin, bag, "--report-on", tmp_path / "no.mcap", *out)
    assert "it is a file" in refused(OutputError, tmp_path, twin, bag, "--out", tmp_path / "file")
    assert "did you mean quadratic_drag?" in refused(TwinError, tmp_path, twin, bag, *out, "--without", "quadratic_drg")
    assert "surrogates must be in" in refused(OptionsError, tmp_path, twin, bag, *out, "--surrogates", "1")
    assert asked == []
