"""The comparison of priors: rows that fill up, means and standard errors, and the page made of them."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from benchmarks.prior import tables
from benchmarks.prior.items import Item, all_items
from benchmarks.prior.measure import COARSE, keep_scores, read_rows
from benchmarks.prior.page import prior_table
from benchmarks.prior.sequences import Split
from benchmarks.provenance import commit
from egophys_core.evaluation import Scores


def item(name: str) -> Item:
    return Item(name=name, path=Path(name), split=Split.HELD_OUT, group="rehearsed", object_seed=0, paper=False)


def errors(test: float) -> Scores:
    values = dict.fromkeys((field.name for field in fields(Scores)), 0.5)
    told = {"train_chamfer_m": 0.01, "test_chamfer_m": test, "train_track_m": 0.02, "test_track_m": 2.0 * test}
    return Scores(**{**values, **told})


def kept(folder: Path, name: str, model: str, test: float | None, seconds: float, anchor: str = "fit") -> None:
    scores = None if test is None else errors(test)
    keep_scores(folder, item(name), model, scores, seconds, anchor=f"{anchor} of {name}")


def test_ratios_are_of_the_items_that_both_have(tmp_path):
    for name, before, after in zip("abc", (0.01, 0.02, 0.03), (0.005, 0.01, None), strict=True):
        kept(tmp_path, name, COARSE, before, 1.0)
        kept(tmp_path, name, "codebook K=4", after, 3.0)
    anchor, learned = tables.table([item(name) for name in "abc"], read_rows(tmp_path))
    assert (anchor["model"], anchor["sequences"], anchor["diverged"]) == (COARSE, 3, 0)
    assert anchor["test_cd_m"] == pytest.approx(0.02)
    assert anchor["se_test_cd_m"] == pytest.approx(0.01 / np.sqrt(3.0))
    assert learned["diverged"] == 1
    assert learned["test_cd_ratio"] == pytest.approx(0.0075 / 0.015)
    assert learned["seconds_per_sequence"] == 3.0


def test_refinement_is_held_against_the_codebook_where_both_are(tmp_path):
    for name, test in zip("ab", (0.01, 0.03), strict=True):
        kept(tmp_path, name, "codebook K=4", test, 2.0)
    kept(tmp_path, "a", "dense 25 steps", 0.02, 50.0, anchor="an older fit")
    kept(tmp_path, "b", "dense 25 steps", 0.02, 50.0)
    (row,) = tables.against_codebook([item(name) for name in "ab"], read_rows(tmp_path))
    assert (row["model"], row["sequences"]) == ("dense 25 steps", 1)
    assert [row["test_cd_ratio"], row["test_te_ratio"], row["seconds_ratio"]] == pytest.approx([1.5, 1.5, 25.0])


def test_the_page_shows_every_model_that_was_measured(tmp_path):
    kept(tmp_path, "a", COARSE, 0.0123, 1.0)
    rows = [{**row, "commit": "aaaaaaa"} for row in tables.table([item("a")], read_rows(tmp_path))]
    result = {
        "rows": rows,
        "sets": {"paper": []},
        "against_codebook": [
            {
                "model": "dense 25 steps",
                "sequences": 2,
                "test_cd_ratio": 1.1,
                "test_te_ratio": 1.2,
                "seconds_ratio": 31.4,
            }
        ],
        "held_out_sequences": 1,
        "rollout_cost_ratio": 1.234,
        "rates": [
            {
                "asked_per_frame": 1,
                "codebook_seconds": 1.0,
                "codebook_apart_mm": 0.4,
                "uniform_seconds": 0.5,
                "uniform_apart_mm": 0.2,
            }
        ],
    }
    page = prior_table(result, {"aaaaaaa": "2026-01-01T00:00:00+00:00"})
    assert "| coarse anchor only | 1 | 10.0 | 12.3 ± - |" in page
    assert "costs 1.23 times" in page
    assert "At aaaaaaa (2026-01-01): coarse anchor only." in page


def test_a_model_keeps_the_row_of_more_sequences():
    def row(model: str, sequences: int, seconds: float) -> dict[str, float | str]:
        return {"model": model, "sequences": sequences, "seconds_per_sequence": seconds}

    earlier = [row(COARSE, 34, 1.0), row("codebook K=8", 34, 2.0), row("dense 25 steps", 11, 3.0)]
    new = [row("dense 25 steps", 11, 4.0), row(COARSE, 2, 5.0), row("Spring-Gaus", 11, 6.0)]
    found = {each["model"]: each["seconds_per_sequence"] for each in tables.with_earlier(new, earlier)}
    assert found == {COARSE: 1.0, "codebook K=8": 2.0, "dense 25 steps": 4.0, "Spring-Gaus": 6.0}


def test_rows_of_one_coarse_fit_stand_in_a_table(tmp_path):
    """What began with an older fit is left out; what needs none is compared with any."""
    kept(tmp_path, "a", COARSE, 0.02, 1.0)
    kept(tmp_path, "a", "dense 25 steps", 0.01, 1.0, anchor="an older fit")
    keep_scores(tmp_path, item("a"), "last observed shape stays", errors(0.04), 0.0, anchor="")
    rows = tables.table([item("a")], read_rows(tmp_path))
    assert [row["model"] for row in rows] == ["last observed shape stays", COARSE]
    assert rows[0]["test_cd_ratio"] == pytest.approx(2.0)


def test_of_two_rows_the_one_measured_now_counts():
    def row(item: str, test: float) -> dict[str, float | str]:
        return {"item": item, "model": COARSE, "test_te_m": test}

    found = tables.newest([row("a", 1.0), row("b", 2.0)], [row("b", 3.0), row("c", 4.0)])
    assert {each["item"]: each["test_te_m"] for each in found} == {"a": 1.0, "b": 3.0, "c": 4.0}


def test_a_row_is_json_that_says_what_it_is_of(tmp_path):
    kept(tmp_path, "a", COARSE, None, 1.5)
    (path,) = tmp_path.glob("*.json")
    row = json.loads(path.read_text())
    assert [row[key] for key in ("item", "model", "anchor", "test_te_m")] == ["a", COARSE, "fit of a", None]
    assert row["commit"] == commit()


def test_no_item_is_trained_on_and_judged():
    items = all_items(Path("data"))
    training = {each.object_seed for each in items if each.split is Split.TRAINING}
    held_out = {each.object_seed for each in items if each.split is Split.HELD_OUT}
    assert not training & held_out
    assert sum(each.paper for each in items if each.split is Split.HELD_OUT) == 11
