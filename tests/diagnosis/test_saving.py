"""Saving a finding: three files or none."""

import json
import os

import pytest

from egophys_core.diagnosis.diagnose import Finding
from egophys_core.diagnosis.diagnosis import Outcome
from egophys_core.diagnosis.saving import effect_texts, save_finding
from egophys_core.effects import LIBRARY
from egophys_core.errors import OutputError
from egophys_core.files import require_new_folder
from egophys_core.twin import load_twin
from tests.diagnosis.findings import make_diagnosis, make_evidence
from tests.twin.examples import make_twin


def make_finding() -> Finding:
    return Finding(
        diagnosis=make_diagnosis(), twin=make_twin(), before=make_twin().model, evidence=make_evidence(), searches=()
    )


def test_three_files_that_can_be_read_again(tmp_path):
    finding = make_finding()
    files = save_finding(finding, tmp_path / "found")
    assert {name: path.name for name, path in files.items()} == {
        "diagnosis": "diagnosis.json",
        "twin": "improved.twin",
        "report": "report.html",
    }
    assert os.listdir(tmp_path) == ["found"]
    assert sorted(os.listdir(tmp_path / "found")) == ["diagnosis.json", "improved.twin", "report.html"]
    assert load_twin(files["twin"]).twin_id == finding.twin.twin_id
    content = json.loads(files["diagnosis"].read_text())
    assert content["outcome"] == Outcome.NAMED
    assert content["where"]["by_region"]["on the table"] is None
    report = files["report"].read_text()
    assert LIBRARY["quadratic_drag"].summary in report
    assert LIBRARY["quadratic_drag"].equation in report


def test_an_empty_folder_is_used(tmp_path):
    (tmp_path / "found").mkdir()
    save_finding(make_finding(), tmp_path / "found")
    assert len(os.listdir(tmp_path / "found")) == 3


@pytest.mark.parametrize("step", ["save_diagnosis", "encode_twin", "report"])
@pytest.mark.parametrize(("error", "seen"), [(OSError(28, "No space left"), OutputError), (KeyboardInterrupt,) * 2])
def test_nothing_is_left_when_it_fails(tmp_path, monkeypatch, step, error, seen):
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(f"egophys_core.diagnosis.saving.{step}", fail)
    with pytest.raises(seen):
        save_finding(make_finding(), tmp_path / "found")
    assert os.listdir(tmp_path) == []


def test_what_is_there_is_not_overwritten(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    for folder, part in (
        (tmp_path / "file", "it is a file"),
        (tmp_path / "full", "not empty"),
        (tmp_path / "no" / "where", "does not exist; create it first"),
    ):
        for refuse in (require_new_folder, lambda folder: save_finding(make_finding(), folder)):
            with pytest.raises(OutputError, match=part) as caught:
                refuse(folder)
            assert str(folder) in str(caught.value)
    assert sorted(os.listdir(tmp_path)) == ["file", "full"]
    assert os.listdir(tmp_path / "full") == ["file"]


def test_every_effect_of_the_library_has_its_text():
    assert set(effect_texts()) == set(LIBRARY)
    for text in effect_texts().values():
        assert text.phrase
        assert text.equation
        assert text.nulls
