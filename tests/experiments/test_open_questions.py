"""What a diagnosis left open: read from its file, and refused where that is damaged."""

import json

import pytest

from egophys_core.diagnosis.diagnosis import save_diagnosis
from egophys_core.errors import DiscrepancyError
from egophys_core.experiments.open_questions import read_open_questions
from tests.diagnosis.findings import make_diagnosis

LIMIT = make_diagnosis().as_dict()["limits"][0]


@pytest.fixture
def path(tmp_path):
    save_diagnosis(make_diagnosis(), tmp_path / "diagnosis.json")
    return tmp_path / "diagnosis.json"


def test_what_was_saved_is_read(path):
    found, saved = read_open_questions(path.parent), make_diagnosis()
    assert (found.ambiguous, found.limits, found.scale_m) == (saved.ambiguous, saved.limits, saved.scale_m)
    assert found.effects == tuple(each.name for each in saved.candidates if each.name != "quadratic_drag")


@pytest.mark.parametrize("content", [5, None, [], "text"])
def test_content_that_is_no_diagnosis_is_refused(path, content):
    path.write_text(json.dumps(content))
    with pytest.raises(DiscrepancyError, match=r"diagnosis.json: a diagnosis is a JSON object, got .*; diagnose again"):
        read_open_questions(path.parent)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"limits": None}, "`limits` must be a list, got None"),
        ({"limits": [{"a": 1}]}, "each of `limits` has effect, parameter, .* got {'a': 1}"),
        ({"limits": ["x"]}, "each of `limits` has"),
        ({"limits": [{**LIMIT, "null": None}]}, "`null` in `limits` must be a finite number, got None"),
        ({"limits": [{**LIMIT, "size": 0}]}, "`size` in `limits` must be a finite number above 0, got 0"),
        ({"limits": [{**LIMIT, "unit": 3}]}, "`unit` in `limits` must be a text, got 3"),
        ({"candidates": ["x"]}, "`candidates`: no effect is called 'x'"),
        ({"candidates": [{"name": "magic"}]}, "`candidates`: no effect is called 'magic'"),
        ({"candidates": [{}]}, "`candidates` must name effects, got None"),
        ({"ambiguous": "drag"}, "`ambiguous` must be a list"),
        ({"scale_m": None}, "`scale_m` must be a finite number above 0, got None"),
        ({"scale_m": 10**400}, "`scale_m` must be a finite number above 0, got 1000"),
    ],
)
def test_damaged_content_is_refused_with_the_key(path, change, text):
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(DiscrepancyError, match=f"diagnosis.json: {text}.*; diagnose again"):
        read_open_questions(path.parent)


@pytest.mark.parametrize("key", ["limits", "ambiguous", "scale_m", "effects", "candidates"])
def test_content_of_an_earlier_version_is_refused(path, key):
    content = json.loads(path.read_text())
    del content[key]
    path.write_text(json.dumps(content))
    with pytest.raises(DiscrepancyError, match=f"it lacks `{key}`, as one of an earlier version does; diagnose again"):
        read_open_questions(path.parent)
