"""The tables of the prior as Markdown, from `benchmarks/results/prior.json`."""

from collections.abc import Mapping
from typing import Any

from benchmarks.revisions import described, newest_first, revisions_in
from benchmarks.tables import table

COLUMNS = ("model", "n", "train CD", "test CD", "/ anchor", "train TE", "test TE", "/ anchor", "s")


def prior_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Errors of every model on all held-out sequences, and on parts of them; mm, and ratios of means."""
    parts = {f"All {result['held_out_sequences']} held-out sequences of the set": result["rows"]}
    parts |= {name.capitalize(): rows for name, rows in result["sets"].items()}
    cost = f"A rollout with the codebook costs {result['rollout_cost_ratio']:.2f} times one without."
    asked = "Asked at other rates, and nodes that move otherwise than where it is asked in every substep:"
    refined = "The codebook's errors over those of refinement, and the CPU time of that over its own, where both are:"
    tables = [f"{name}:\n\n{_part(rows, dates)}" for name, rows in parts.items() if rows]
    return "\n\n".join([*tables, refined, _against(result), cost, asked, _rates(result["rates"])])


def _models_of(revision: str, rows: list[dict[str, Any]]) -> str:
    return ", ".join(row["model"] for row in rows if row["commit"] == revision)


def _part(rows: list[dict[str, Any]], dates: Mapping[str, str]) -> str:
    revisions = newest_first(revisions_in(rows), dates)
    measured = [f"At {described(each, dates)}: {_models_of(each, rows)}." for each in revisions]
    return "\n\n".join([table(COLUMNS, [_line(row) for row in rows]), " ".join(measured)])


def _rates(rows: list[dict[str, Any]]) -> str:
    return table(
        ("asked a frame", "apart, mm", "the same cuts without codebook, mm", "s", "s without"),
        [
            [
                str(row["asked_per_frame"]),
                f"{row['codebook_apart_mm']:.2f}",
                f"{row['uniform_apart_mm']:.2f}",
                f"{row['codebook_seconds']:.1f}",
                f"{row['uniform_seconds']:.1f}",
            ]
            for row in rows
        ],
    )


def _against(result: dict[str, Any]) -> str:
    return table(
        ("model", "n", "test CD", "test TE", "time"),
        [
            [
                row["model"],
                str(row["sequences"]),
                *(f"{row[key]:.2f}" for key in ("test_cd_ratio", "test_te_ratio")),
                f"{row['seconds_ratio']:.0f}",
            ]
            for row in result["against_codebook"]
        ],
    )


def _line(row: dict[str, Any]) -> list[str]:
    lost = f" ({row['diverged']} diverged)" if row["diverged"] else ""
    return [
        row["model"],
        f"{row['sequences']}{lost}",
        _millimetres(row["train_cd_m"]),
        f"{_millimetres(row['test_cd_m'])} ± {_millimetres(row['se_test_cd_m'])}",
        _ratio(row, "test_cd"),
        _millimetres(row["train_te_m"]),
        f"{_millimetres(row['test_te_m'])} ± {_millimetres(row['se_test_te_m'])}",
        _ratio(row, "test_te"),
        f"{row['seconds_per_sequence']:.1f}",
    ]


def _millimetres(value: float | None) -> str:
    return "-" if value is None else f"{1e3 * value:.1f}"


def _ratio(row: dict[str, Any], key: str) -> str:
    ratio, error = row[f"{key}_ratio"], row[f"se_{key}_ratio"]
    return "-" if ratio is None else f"{ratio:.2f} ± {error:.2f}" if error is not None else f"{ratio:.2f}"
