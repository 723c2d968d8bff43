"""Run the benchmarks, write `results/NAME.json` and renew the tables of the README from these files."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import beam, blind, cable, cost, effects, perception, physics, planted, towel
from benchmarks.provenance import commit, machine
from egophys_core.files import write_atomically, write_json

REPOSITORY = Path(__file__).resolve().parents[1]
RESULTS = REPOSITORY / "benchmarks/results"
BENCHMARKS: dict[str, Callable[[], dict[str, Any]]] = {
    "physics": physics.run,
    "effects": effects.run,
    "towel": towel.run,
    "perception": perception.run,
    "planted": planted.run,
    "diagnoses": blind.run,
    "beam": beam.run,
    "cable": cable.run,
    "cost": cost.run,
}


def main() -> None:
    """Run those named on the command line, or all."""
    names = sys.argv[1:] or list(BENCHMARKS)
    if unknown := [name for name in names if name not in BENCHMARKS]:
        sys.exit(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(BENCHMARKS)}")
    for name in names:
        result = {**BENCHMARKS[name](), "machine": machine(), "commit": commit(), "command": "make bench"}
        write_json(RESULTS / f"{name}.json", result)
        print(json.dumps(result, indent=1))
        if name == "diagnoses":
            blind.write_blind(result["cases"])
    renew_tables()


def renew_tables() -> None:
    """Put each result's table between its two markers in the README."""
    readme = (REPOSITORY / "README.md").read_text()
    for name, result, table in (
        ("simulation", "physics", _simulation_table),
        ("accuracy", "physics", _accuracy_table),
        ("towel", "towel", _towel_table),
        ("perception", "perception", _perception_table),
        ("planted", "planted", _planted_table),
        ("diagnoses", "diagnoses", _diagnoses_table),
        ("beam", "beam", _beam_table),
        ("cable", "cable", _cable_table),
        ("cost", "cost", _cost_table),
    ):
        path = RESULTS / f"{result}.json"
        measured = path.exists()
        text = table(json.loads(path.read_text())) if measured else f"Not measured yet: `make bench` ({result})."
        before, begin, rest = readme.partition(f"<!-- benchmark {name} -->\n")
        if not begin:
            raise ValueError(f"README.md has no line <!-- benchmark {name} --> to put the table below")
        _, end, after = rest.partition("<!-- end -->")
        readme = f"{before}{begin}{text}\n{end}{after}"
    write_atomically(REPOSITORY / "README.md", readme.encode())


def _cost_table(result: dict[str, Any]) -> str:
    lines = ["| points | episodes | candidates | elapsed | CPU time | over the yardstick's |", "|" + " --- |" * 6]
    lines += [
        f"| {row['points']} | {row['episodes']} | {row['candidates']} | {row['elapsed_s']:.0f} s "
        f"| {row['cpu_s']:.0f} s | {row['cpu_per_yardstick']:.1f} |"
        for row in result["rows"]
    ]
    return "\n".join(lines)


def _diagnoses_table(result: dict[str, Any]) -> str:
    lines = [
        "| case | outcome | effects | track before | track after | Chamfer before | Chamfer after | s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, case in result["cases"].items():
        held = [error for error in case["error"] if not error["fitted"]]
        keys = ("track_before_m", "track_after_m", "chamfer_before_m", "chamfer_after_m")
        means = [f"{1000 * sum(error[key] for error in held) / len(held):.1f}" for key in keys]
        effects = ", ".join(effect["name"] for effect in case["effects"]) or "-"
        lines.append(f"| {name} | {case['outcome']} | {effects} | {' | '.join(means)} | {case['seconds']:.0f} |")
    return "\n".join(lines)


def _beam_table(result: dict[str, Any]) -> str:
    lines = [
        "| record | load (N) | | springs and gravity alone | as built | refitted, no effect | with what is named |",
        "|" + " --- |" * 7,
    ]
    for name, errors in result["rmse_m"].items():
        fitted = "fitted" if name in result["fitted"] else "held out"
        swing = result["swing_rmse_m"][name]
        millimetres = " | ".join(f"{1e3 * errors[key]:.2f} ({1e3 * swing[key]:.2f})" for key in errors)
        lines.append(f"| {name} | {result['loads_n'][name]:g} | {fitted} | {millimetres} |")
    said = f"The diagnosis: {result['outcome']} ({_named(result['effects']) or 'no name'}); {result['reason']}."
    return "\n".join([*lines, "", said])


def _cable_table(result: dict[str, Any]) -> str:
    lines = [
        "| planted | the diagnosis | motion of the hands | | as built | refitted, no effect | with what is named | s |",
        "|" + " --- |" * 8,
    ]
    for name, row in result["cables"].items():
        outcome = f"{row['outcome']}: {_named(row['effects'])}" if row["effects"] else row["outcome"]
        planted = ", ".join([name, *(f"{number} {value:g}" for number, value in row["planted"].items())])
        for index, (motion, errors) in enumerate(row["rmse_m"].items()):
            first = (planted, outcome) if index == 0 else ("", "")
            fitted = "held out" if motion == result["held_out"] else "fitted"
            millimetres = [f"{1e3 * each:.1f}" for each in errors.values()]
            seconds = f"{row['build_seconds'] + row['diagnose_seconds']:.0f}" if index == 0 else ""
            lines.append(f"| {' | '.join([*first, motion.replace('_', ' '), fitted, *millimetres, seconds])} |")
    return "\n".join(lines)


def _named(effects: list[dict[str, Any]]) -> str:
    """The effects with their numbers and intervals."""
    return ", ".join(
        f"{effect['name']}: "
        + ", ".join(
            f"{name} {number['value']:.3g} ({number['ci95'][0]:.3g} to {number['ci95'][1]:.3g})"
            + ("" if number["unit"] == "1" else f" {number['unit']}")
            for name, number in effect["parameters"].items()
        )
        for effect in effects
    )


def _planted_table(result: dict[str, Any]) -> str:
    """The confusion matrix: what was said of each planted effect, by size, with its entry in the library or not."""
    nothing = [row for row in result["rows"] if row["effect"] == "none"]
    planted = [row for row in result["rows"] if row["effect"] != "none"]
    found = {(row["effect"], row["size"], bool(row["without"])): row for row in planted}
    columns = [(size, left_out) for left_out in (False, True) for size in ("large", "small")]
    lines = [
        f"{_share(nothing, [])} of the sets without an effect were given no name"
        + "".join(f"; {row['object']}, {' and '.join(row['motions'])}: {_said(row)}" for row in nothing if row["named"])
        + ". Named right: "
        + ", ".join(f"{_share(_of(planted, size, False), None)} of the {size} ones" for size in ("large", "small"))
        + "; it is among what cannot be told apart in "
        + " and ".join(f"{_among(_of(planted, size, False))} more" for size in ("large", "small"))
        + ". No name with the entry left out: "
        + ", ".join(f"{_share(_of(planted, size, True), [])} of the {size} ones" for size in ("large", "small"))
        + ".",
        "",
        "| planted | moves points by (mm) | large | small | large, entry left out | small, entry left out |",
        "|---|---|---|---|---|---|",
    ]
    moved = result.get("moved_m", {})
    for name in sorted({row["effect"] for row in planted}):
        cells = [
            ", ".join(f"{1000 * moved[name][size]:.1f}" for size in ("large", "small") if size in moved.get(name, {}))
        ]
        cells += [_said(found[name, *column]) if (name, *column) in found else "" for column in columns]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _of(rows: list[dict[str, Any]], size: str, left_out: bool) -> list[dict[str, Any]]:
    return [row for row in rows if row["size"] == size and bool(row["without"]) == left_out]


def _share(rows: list[dict[str, Any]], names: list[str] | None) -> str:
    """How many were given just these names, or, with None, that of what was planted; ambiguous sets name nothing."""
    right = sum(_names(row) == ([row["effect"]] if names is None else names) for row in rows)
    return f"{right} of {len(rows)}"


def _among(rows: list[dict[str, Any]]) -> int:
    """How many ambiguous sets have what was planted in them."""
    return sum(row["outcome"] == "ambiguous" and row["effect"] in row["named"] for row in rows)


def _names(row: dict[str, Any]) -> list[str]:
    return [] if row["outcome"] == "ambiguous" else list(row["named"])


def _said(row: dict[str, Any]) -> str:
    if not row["named"]:
        return str(row["outcome"])
    if row["outcome"] == "ambiguous":
        # What mimics it may be left out of the library.
        return " or ".join(row["named"] if len(row["named"]) > 1 else [*row["named"], "another"])
    return " and ".join(row["named"]) + (", and a rest" if row["outcome"] == "named_and_unexplained" else "")


def _simulation_table(result: dict[str, Any]) -> str:
    def row(name: str, rate: str, ratio: float) -> str:
        return f"| {name} | {result[rate] / 1e6:.0f} | {ratio:.1f} |"

    return "\n".join(
        [
            "| 2,000 nodes, 20,000 springs | million spring updates/s | ratio |",
            "|---|---|---|",
            row("yardstick: one rollout, a spring per thread, atomic adds", "yardstick_updates_per_s", 1.0),
            row("16 rollouts, per core (CPU time)", "batched_updates_per_s_core", result["ratio_core_median"]),
            row(
                "16 rollouts, two cores (elapsed time)", "batched_updates_per_s_machine", result["ratio_machine_median"]
            ),
            "",
            f"A second of that sheet, hanging, within {1000 * result['equal_accuracy_error_m']:.2f} mm of the "
            f"reference with 667 substeps a frame, takes {result['equal_accuracy_substeps']} substeps a frame and "
            f"1/{1 / result['equal_accuracy_cost_ratio']:.0f} of the yardstick's CPU time. "
            f"{result['cma_generations']} generations of CMA-ES on the shipped episode ({result['cma_nodes']} nodes) "
            f"take {result['cma_minutes']:.1f} minutes.",
        ]
    )


def _accuracy_table(result: dict[str, Any]) -> str:
    """Means over the episodes that a model was measured on, and what it changes of the coarse fit's there."""
    rows = result["accuracy"]
    keys = ("train_cd_m", "test_cd_m", "train_te_m", "test_te_m")
    lines = [
        "| kind | model | episodes | train CD | test CD | train TE | test TE | test TE - coarse | worse in | minutes |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in sorted({row["kind"] for row in rows}):
        of_kind = [row for row in rows if row["kind"] == kind]
        coarse = {row["episode"]: row["test_te_m"] for row in of_kind if row["model"] == "coarse"}
        for model in dict.fromkeys(row["model"] for row in of_kind):
            of_model = [row for row in of_kind if row["model"] == model]
            means = [_mean([row[key] for row in of_model]) for key in keys]
            cells = ["-" if mean is None else f"{1000 * mean:.1f}" for mean in means]
            changes = [row["test_te_m"] - coarse[row["episode"]] for row in of_model]
            worse = sum(change > 0 for change in changes)
            change = "" if model == "coarse" else f"{1000 * sum(changes) / len(changes):+.1f}"
            minutes = f"{_mean([row['minutes'] for row in of_model]):.1f}"
            lines.append(
                f"| {kind} | {model} | {len(of_model)} | {' | '.join(cells)} | {change} | "
                f"{'' if model == 'coarse' else worse} | {minutes} |"
            )
    return "\n".join(lines)


def _mean(values: list[float | None]) -> float | None:
    numbers = [value for value in values if value is not None]
    return sum(numbers) / len(numbers) if numbers else None


def _towel_table(result: dict[str, Any]) -> str:
    keys = ("train_chamfer_m", "test_chamfer_m", "train_track_m", "test_track_m")

    def row(name: str, scores: dict[str, Any]) -> str:
        cells = ("-" if scores[key] is None else f"{1000 * scores[key]:.1f}" for key in keys)
        return f"| {name} | {' | '.join(cells)} |"

    return "\n".join(
        [
            f"| {result['generations']} generations (mm) | train CD | test CD | train TE | test TE |",
            "|---|---|---|---|---|",
            *(row(f"twin, seed {fit['seed']}", fit) for fit in result["fits"]),
            *(row(name, scores) for name, scores in result["baselines"].items()),
        ]
    )


def _perception_table(result: dict[str, Any]) -> str:
    columns = (
        ("mean mm", "mean_mm", 1),
        ("p95 mm", "p95_mm", 1),
        ("coverage", "coverage", 2),
        ("ids stable", "id_stability", 3),
        ("pose mm", "pose_mm", 2),
        ("pose deg", "pose_deg", 3),
        ("mask J", "mask_j", 3),
        ("mask F", "mask_f", 3),
        ("delta_avg", "track_delta_avg", 3),
        ("AJ", "track_aj", 3),
        ("OA", "track_oa", 3),
        ("views", "views", 0),
        ("s", "seconds", 0),
    )

    def row(scores: dict[str, Any]) -> str:
        cells = ("-" if scores[key] is None else f"{scores[key]:.{digits}f}" for _, key, digits in columns)
        return f"| {scores['video']} | {' | '.join(cells)} |"

    return "\n".join(
        [
            f"| video | {' | '.join(name for name, _, _ in columns)} |",
            f"|{'---|' * (len(columns) + 1)}",
            *(row(scores) for scores in result["rows"]),
        ]
    )


if __name__ == "__main__":
    main()
