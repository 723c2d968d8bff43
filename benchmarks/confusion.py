"""The confusion matrix of injected effects: what was said of each, by size, with its entry in the library or not."""

from collections.abc import Mapping
from typing import Any

from benchmarks.revisions import described, newest_first
from benchmarks.tables import table

Rows = list[dict[str, Any]]

MARKS = "abcdefghijklmnopqrstuvwxyz"
"""Of older revisions, newest first."""


def confusion_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Counts, the matrix, and which cells were measured at which revision."""
    nothing = [row for row in result["rows"] if row["effect"] == "none"]
    injected = [row for row in result["rows"] if row["effect"] != "none"]
    newest, *older = newest_first((row["commit"] for row in result["rows"]), dates)
    mark = {newest: "", **{revision: f" <sup>{MARKS[index]}</sup>" for index, revision in enumerate(older)}}
    found = {(row["effect"], row["size"], bool(row["without"])): row for row in injected}
    columns = [(size, left_out) for left_out in (False, True) for size in ("large", "small")]
    moved = result.get("moved_m", {})
    lines = []
    for name in sorted({row["effect"] for row in injected}):
        sizes = [f"{1000 * moved[name][size]:.1f}" for size in ("large", "small") if size in moved.get(name, {})]
        cells = [found.get((name, *column)) for column in columns]
        lines.append(
            [name, ", ".join(sizes), *("" if row is None else said(row) + mark[row["commit"]] for row in cells)]
        )
    header = ["injected", "moves points by (mm)", "large", "small", "large, entry left out", "small, entry left out"]
    legend = [f"no mark: {described(newest, dates)}"]
    legend += [f"{mark[each].strip()}: {described(each, dates)}" for each in older]
    sets = ", ".join(
        f"{sum(row['commit'] == revision for row in nothing)} at {described(revision, dates)}"
        for revision in newest_first((row["commit"] for row in nothing), dates)
    )
    return "\n\n".join(
        [
            _counts(nothing, injected),
            table(header, lines),
            f"Cells by the revision that they were measured at: {'; '.join(legend)}. Sets without an effect: {sets}.",
        ]
    )


def _counts(nothing: Rows, injected: Rows) -> str:
    """How many of all cells, of whatever revision, are right."""
    return (
        f"{_share(nothing, [])} of the sets without an effect were given no name"
        + "".join(f"; {row['object']}, {' and '.join(row['motions'])}: {said(row)}" for row in nothing if row["named"])
        + ". Named right: "
        + ", ".join(f"{_share(_of(injected, size, False), None)} of the {size} ones" for size in ("large", "small"))
        + "; it is among what cannot be told apart in "
        + " and ".join(f"{_among(_of(injected, size, False))} more" for size in ("large", "small"))
        + ". No name with the entry left out: "
        + ", ".join(f"{_share(_of(injected, size, True), [])} of the {size} ones" for size in ("large", "small"))
        + ". (Counted over all revisions.)"
    )


def _of(rows: Rows, size: str, left_out: bool) -> Rows:
    return [row for row in rows if row["size"] == size and bool(row["without"]) == left_out]


def _share(rows: Rows, names: list[str] | None) -> str:
    """How many were given just these names, or, with None, that of what was injected; ambiguous sets name nothing."""
    right = sum(_names(row) == ([row["effect"]] if names is None else names) for row in rows)
    return f"{right} of {len(rows)}"


def _among(rows: Rows) -> int:
    """How many ambiguous sets have what was injected in them."""
    return sum(row["effect"] in row["named"] and row["effect"] not in _names(row) for row in rows)


def _names(row: dict[str, Any]) -> list[str]:
    match row["outcome"]:
        case "ambiguous":
            return []
        case "named_and_ambiguous":
            return list(row["beside"])
        case _:
            return list(row["named"])


def said(row: dict[str, Any]) -> str:
    """The outcome of one diagnosis in a few words."""
    if not row["named"]:
        return str(row["outcome"])
    if row["outcome"] == "ambiguous":
        # What it is confused with may be left out of the library.
        return " or ".join(row["named"] if len(row["named"]) > 1 else [*row["named"], "another"])
    if row["outcome"] == "named_and_ambiguous":
        known = row["beside"]
        return f"{' and '.join(known)}, and {' or '.join(row['named'][len(known) :])}"
    return " and ".join(row["named"]) + (", and a rest" if row["outcome"] == "named_and_unexplained" else "")
