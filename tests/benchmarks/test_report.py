"""docs/results.md is what its generator makes of the committed results; revisions are kept apart."""

import json

import pytest

from benchmarks.confusion import confusion_table
from benchmarks.report import PAGE, TABLES, page, read_results
from benchmarks.revisions import DATES, described, newest_first, revisions_in
from benchmarks.tables import by_revision, measured_table

SOME_DATES = {"aaaaaaa": "2026-01-01T00:00:00+00:00", "bbbbbbb": "2026-02-01T00:00:00+00:00"}


def test_page_is_what_the_generator_gives():
    text = page(read_results(), json.loads(DATES.read_text()))
    assert PAGE.read_text() == text, "run `python -m benchmarks.run report`"


def test_page_says_what_was_looked_at_beside_each_table():
    text = PAGE.read_text()
    sections = text.split("\n## ")[1:]
    assert len(sections) == len(TABLES)
    for section in sections:
        for part in ("**Data.**", "**Calibrated and looked at.**", "**Measured.**", "\n| --- |"):
            assert part in section, section.splitlines()[0]
    assert "<!--" not in text


def test_a_result_that_is_missing_says_how_to_get_it():
    dates = json.loads(DATES.read_text())
    results = {name: result for name, result in read_results().items() if name != "cost"}
    assert "Not measured yet: `python -m benchmarks.run cost`" in page(results, dates)


def test_revisions_are_found_wherever_they_are():
    content = {
        "commit": "aaaaaaa",
        "rows": [{"commit": "bbbbbbb-dirty"}, {"x": 1}],
        "cases": {"a": {"commit": "aaaaaaa"}},
    }
    assert revisions_in(content) == {"aaaaaaa", "bbbbbbb-dirty"}


def test_revisions_are_ordered_by_their_newest_commit():
    span = "aaaaaaa to bbbbbbb"
    assert newest_first(["aaaaaaa", span, "aaaaaaa-dirty"], SOME_DATES) == [span, "aaaaaaa-dirty", "aaaaaaa"]
    assert described("aaaaaaa-dirty", SOME_DATES) == "aaaaaaa and changes not yet committed (2026-01-01)"


def test_rows_of_older_revisions_stand_apart_and_say_theirs():
    rows = [("aaaaaaa", [["old", "1"], ["", "2"]]), ("bbbbbbb", [["new", "3"]])]
    newest, older = by_revision(["what", "mm"], rows, SOME_DATES).split("Measured at older revisions")
    assert "| new | 3 |" in newest
    assert "old" not in newest
    assert "| old | 1 | aaaaaaa (2026-01-01) |" in older
    assert "new" not in older


@pytest.mark.parametrize(
    ("outcome", "names", "cell"),
    [
        ("named", ["drag"], "drag"),
        ("none", [], "none"),
        ("ambiguous", ["tilt"], "tilt or another"),
        ("named_and_unexplained", ["drag"], "drag, and a rest"),
        ("named_and_ambiguous", ["delay", "drag", "tilt"], "delay, and drag or tilt"),
    ],
)
def test_confusion_matrix_marks_cells_of_older_revisions(outcome, names, cell):
    def row(effect, size, commit, **changes):
        return {
            "effect": effect,
            "size": size,
            "without": "",
            "commit": commit,
            "outcome": "none",
            "named": [],
        } | changes

    rows = [
        row("none", "", "bbbbbbb", object="sheet", motions=["lift"]),
        row("drag", "large", "aaaaaaa", outcome=outcome, named=names, beside=names[:1]),
        row("drag", "small", "bbbbbbb"),
    ]
    text = confusion_table({"rows": rows, "moved_m": {"drag": {"large": 0.01}}}, SOME_DATES)
    assert f"| drag | 10.0 | {cell} <sup>a</sup> | none |" in text
    assert "1 of 1 of the sets without an effect" in text
    assert f"{int(names == ['drag'] and outcome != 'ambiguous')} of 1 of the large ones" in text


def test_what_measured_recordings_could_have_shown_is_said_where_it_was_measured():
    limit = {"effect": "quadratic_drag", "parameter": "coefficient", "size": 4.0, "unit": "1/m", "alike": []}
    row = {
        "record": "a",
        "fitted": True,
        "static_mm": 1,
        "rigid_lag_mm": 1,
        "built_mm": 1,
        "before_mm": 1,
        "after_mm": 1,
    }
    told = {"records": ["a"], "outcome": "none", "effects": {}, "reason": "why", "seconds": 1.0, "commit": "aaaaaaa"}
    asked = {"motion": "swing", "sentence": "Swing it.", "after": [{**limit, "size": 1.0}]}
    sets = {
        "old": {"rows": [row], "diagnosis": told},
        "cloth": {"rows": [row], "diagnosis": {**told, "limits": [limit], "experiment": asked}},
        "cable": {"rows": [row], "diagnosis": {**told, "limits": [limit], "experiment": {"refused": "none fits"}}},
    }
    text = measured_table({"sets": sets}, SOME_DATES)
    assert (
        "- cloth: quadratic_drag from 4 1/m. Next: swing, which is expected to name quadratic_drag from 1 1/m." in text
    )
    assert "No motion is proposed: none fits." in text
    assert text.count("- old:") == 1
