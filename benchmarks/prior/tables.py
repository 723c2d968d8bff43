"""The tables of the prior: means over held-out items, with standard errors, and how long each model takes."""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.prior.anchors import ANCHORS, is_anchored, read_anchored
from benchmarks.prior.dataset import FOLDER
from benchmarks.prior.items import Item, all_items
from benchmarks.prior.measure import (
    COARSE,
    CODEBOOK,
    DENSE,
    LEARNED,
    REFINED,
    ROWS,
    SEARCHED,
    SPRING_GAUS,
    checkpoint,
    read_rows,
    rollout_cost_ratio,
)
from benchmarks.prior.rate import rates
from benchmarks.prior.sequences import Split
from egophys_core.evaluation.baselines import BASELINES
from egophys_core.prior import load_codebook

RESULT = Path(__file__).resolve().parents[1] / "results/prior.json"

TRAINED = Path(__file__).parent / "checkpoints"
"""What was trained; training itself writes to out/prior/trained."""

MODELS = (
    *BASELINES,
    COARSE,
    *LEARNED,
    *DENSE,
    SPRING_GAUS,
    *REFINED,
    SEARCHED,
)
Rows = list[dict[str, Any]]

ERRORS = ("train_cd_m", "test_cd_m", "train_te_m", "test_te_m")
RATE_ITEMS = 2
"""Items on which it is measured what asking the codebook more often changes."""


def run(data: Path = FOLDER, anchors: Path = ANCHORS, trained: Path = TRAINED, rows: Path = ROWS) -> dict[str, Any]:
    """What goes into `benchmarks/results/prior.json`, from the rows that are there and what the file has of others."""
    earlier = json.loads(RESULT.read_text())
    held_out = [each for each in all_items(data) if each.split is Split.HELD_OUT]
    rehearsed = [each for each in held_out if each.group == "rehearsed"]
    parts = {
        "rows": rehearsed,
        "paper": [each for each in held_out if each.paper],
        "open and blind": [each for each in held_out if each.group != "rehearsed"],
    }
    of_items = newest(earlier["of_items"], read_rows(rows))
    before = {"rows": earlier["rows"], **earlier["sets"]}
    measured = {name: with_earlier(table(items, of_items), before[name]) for name, items in parts.items()}
    judged = [read_anchored(each, anchors) for each in held_out if is_anchored(each, anchors)]
    codebook = load_codebook(checkpoint(trained, CODEBOOK))
    return {
        "rows": measured.pop("rows"),
        "sets": measured,
        "against_codebook": against_codebook(rehearsed, of_items) or earlier["against_codebook"],
        "held_out_sequences": len(rehearsed),
        **rollout_cost_ratio(judged, codebook),
        "rates": rates(judged[:RATE_ITEMS], codebook),
        "of_items": of_items,
    }


def newest(earlier: Rows, measured: Rows) -> Rows:
    """A row of each item and model: of those that are in both, the one that was measured now."""
    return list({(row["item"], row["model"]): row for row in (*earlier, *measured)}.values())


def with_earlier(rows: Rows, earlier: Rows) -> Rows:
    """Of each model the row of more sequences: of ablations, which take hours to train, only the means are kept."""
    measured = {row["model"]: row for row in rows}
    known = {row["model"]: row for row in earlier}
    both = [
        [each[model] for each in (measured, known) if model in each] for model in MODELS if model in measured | known
    ]
    return [max(each, key=lambda row: row["sequences"]) for each in both]


def table(items: list[Item], rows: Rows) -> Rows:
    """A row for every model that has been measured on some of these items.

    Ratios are of means over the items that the model and the coarse anchor both have; their standard errors are those
    of the mean difference. What began with another coarse fit of an item is left out.
    """
    coarse = _by_item(items, COARSE, rows)
    found = []
    for model in MODELS:
        own_rows = _by_item(items, model, rows)
        measured = [row for item, row in own_rows.items() if _began_alike(row, coarse.get(item))]
        if not measured:
            continue
        row: dict[str, Any] = {"model": model, "sequences": len(measured)}
        row["commit"] = " and ".join(sorted({each["commit"] for each in measured}))
        row["diverged"] = sum(each["test_te_m"] is None for each in measured)
        own = {key: _values(measured, key) for key in ERRORS}
        anchor = {key: _values([coarse[each["item"]] for each in measured], key) for key in ERRORS}
        for key in ERRORS:
            row[key] = _mean(own[key]) if np.isfinite(own[key]).any() else None
        for key in ("test_cd_m", "test_te_m"):
            both = np.isfinite(own[key]) & np.isfinite(anchor[key])
            row[f"se_{key}"] = _standard_error(own[key])
            row[f"{key[:-2]}_ratio"] = _mean(own[key][both]) / _mean(anchor[key][both]) if both.any() else None
            change = _standard_error(own[key][both] - anchor[key][both])
            row[f"se_{key[:-2]}_ratio"] = None if change is None else change / _mean(anchor[key][both])
        row["seconds_per_sequence"] = _mean(np.array([each["seconds"] for each in measured]))
        found.append(row)
    return found


def against_codebook(items: list[Item], rows: Rows) -> Rows:
    """Per model that refines, over the sequences that both have: means of the codebook's errors over its own, and of
    its own CPU time over the codebook's."""
    learned = {item: row for item, row in _by_item(items, CODEBOOK, rows).items() if row["test_te_m"] is not None}
    found = []
    for model in (*DENSE, SPRING_GAUS):
        own = [
            row
            for item, row in _by_item(items, model, rows).items()
            if _began_alike(row, learned.get(item)) and row["test_te_m"] is not None
        ]
        if own:
            other = [learned[row["item"]] for row in own]
            errors = {
                f"{key[:-2]}_ratio": _mean(_values(other, key)) / _mean(_values(own, key))
                for key in ("test_cd_m", "test_te_m")
            }
            seconds = [_mean(_values(each, "seconds")) for each in (own, other)]
            found.append({"model": model, "sequences": len(own), **errors, "seconds_ratio": seconds[0] / seconds[1]})
    return found


def _by_item(items: list[Item], model: str, rows: Rows) -> dict[str, dict[str, Any]]:
    """The rows of a model on some items, by name of the item, in their order."""
    known = {row["item"]: row for row in rows if row["model"] == model}
    return {item.name: known[item.name] for item in items if item.name in known}


def _began_alike(row: dict[str, Any], other: dict[str, Any] | None) -> bool:
    """Whether there is another row, and both began with the same coarse fit, if they began with one."""
    return other is not None and (not row["anchor"] or row["anchor"] == other["anchor"])


def _values(rows: Rows, key: str) -> np.ndarray:
    return np.array([np.nan if row[key] is None else row[key] for row in rows])


def _mean(values: np.ndarray) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return float(np.nanmean(values))


def _standard_error(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.std(ddof=1) / np.sqrt(len(finite))) if len(finite) > 1 else None
