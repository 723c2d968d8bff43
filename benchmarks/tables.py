"""Results of benchmarks as Markdown tables: pure functions of what `benchmarks/results` holds."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmarks.revisions import described, newest_first
from egophys_core.reporting import limits_in_words

Row = Sequence[str]


def table(header: Row, rows: Iterable[Row]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def by_revision(header: Row, rows: Sequence[tuple[str, Sequence[Row]]], dates: Mapping[str, str]) -> str:
    """One table of the rows of the newest revision, and one of those of older ones, which says theirs.

    Args:
        header: names of the columns.
        rows: of each thing measured the revision, and its lines.
        dates: of commits, by hash.
    """
    order = newest_first((revision for revision, _ in rows), dates)
    newest = [line for revision, lines in rows if revision == order[0] for line in lines]
    parts = [f"Measured at {described(order[0], dates)}:", table(header, newest)]
    older = [
        [*line, described(revision, dates) if index == 0 else ""]
        for wanted in order[1:]
        for revision, lines in rows
        if revision == wanted
        for index, line in enumerate(lines)
    ]
    if older:
        parts += ["Measured at older revisions, which may behave otherwise:", table([*header, "revision"], older)]
    return "\n\n".join(parts)


def perception_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Errors of each video."""
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
    rows = [[row["video"], *(_or_dash(row[key], digits) for _, key, digits in columns)] for row in result["rows"]]
    return table(["video", *(name for name, _, _ in columns)], rows)


def film_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Surface, hands and twins of each recorded video."""
    columns = (
        ("mean mm", "surface_mean_mm", 1),
        ("p95 mm", "surface_p95_mm", 1),
        ("coverage", "coverage", 2),
        ("least second", "least_coverage_second", 2),
        ("wrong", "wrong_share_confident", 3),
        ("twin, video", "twin_video_te_mm", 1),
        ("twin, points", "twin_points_te_mm", 1),
        ("static", "static_te_mm", 1),
        ("s", "seconds", 0),
    )
    header = ["video", "kind", "hands", "hand mm", *(name for name, _, _ in columns), "failed"]
    rows = []
    for row in result["rows"]:
        hands = ", ".join(_or_dash(each, 0) for each in row["hand_mean_mm"] or [])
        figures = [_or_dash(row[key], digits) for _, key, digits in columns]
        line = [row["video"], row["kind"] or "-", row["hands"] or "-", hands or "-", *figures, row["why"]]
        rows.append((row["commit"], [line]))
    return by_revision(header, rows, dates)


def _or_dash(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def cost_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Time of a diagnosis over points, episodes and candidates."""
    rows = [
        [
            *(str(row[key]) for key in ("points", "episodes", "candidates")),
            f"{row['elapsed_s']:.0f} s",
            f"{row['cpu_s']:.0f} s",
            f"{row['cpu_per_yardstick']:.1f}",
        ]
        for row in result["rows"]
    ]
    return table(["points", "episodes", "candidates", "elapsed", "CPU time", "over the yardstick's"], rows)


def effects_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """What each effect that acts in the simulator costs."""
    rows = [
        [
            name.replace("_", " "),
            f"{row['cpu_ratio']:.2f}",
            f"{row['substeps_ratio']:.2f}",
            f"{row['threads_busy']:.1f}",
        ]
        for name, row in result["effects"].items()
    ]
    return table(["effect", "CPU time over that without it", "substeps over those without it", "threads busy"], rows)


def diagnoses_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """What was said of each recorded case, and errors on the episodes that were not fitted."""
    keys = ("track_before_m", "track_after_m", "chamfer_before_m", "chamfer_after_m")
    rows = []
    for name, case in result["cases"].items():
        held = [error for error in case["error"] if not error["fitted"]]
        means = [f"{1000 * sum(error[key] for error in held) / len(held):.1f}" for key in keys]
        effects = ", ".join(effect["name"] for effect in case["effects"]) or "-"
        rows.append((case["commit"], [[name, case["outcome"], effects, *means, f"{case['seconds']:.0f}"]]))
    header = ["case", "outcome", "effects", "track before", "track after", "Chamfer before", "Chamfer after", "s"]
    return by_revision(header, rows, dates)


def beam_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Errors of each record, and the diagnosis."""
    rows = []
    for name, errors in result["rmse_m"].items():
        swing = result["swing_rmse_m"][name]
        millimetres = [f"{1e3 * errors[key]:.2f} ({1e3 * swing[key]:.2f})" for key in errors]
        fitted = "fitted" if name in result["fitted"] else "held out"
        rows.append([name, f"{result['loads_n'][name]:g}", fitted, *millimetres])
    header = [
        "record",
        "load (N)",
        "",
        "springs and gravity alone",
        "as built",
        "refitted, no effect",
        "with the effect",
    ]
    said = f"The diagnosis: {result['outcome']} ({named(result['effects']) or 'no name'}); {result['reason']}."
    return f"{table(header, rows)}\n\n{said}"


def cable_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Errors of each cable in three motions of the hands, and its diagnosis."""
    rows = []
    for name, row in result["cables"].items():
        outcome = f"{row['outcome']}: {named(row['effects'])}" if row["effects"] else row["outcome"]
        injected = ", ".join([name, *(f"{number} {value:g}" for number, value in row["injected"].items())])
        seconds = f"{row['build_seconds'] + row['diagnose_seconds']:.0f}"
        lines = []
        for index, (motion, errors) in enumerate(row["rmse_m"].items()):
            first = [injected, outcome] if index == 0 else ["", ""]
            fitted = "held out" if motion == result["held_out"] else "fitted"
            millimetres = [f"{1e3 * each:.1f}" for each in errors.values()]
            lines.append([*first, motion.replace("_", " "), fitted, *millimetres, seconds if index == 0 else ""])
        rows.append((row["commit"], lines))
    header = ["injected", "the diagnosis", "motion", "", "as built", "refitted, no effect", "with the effect", "s"]
    return by_revision(header, rows, dates)


def measured_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Errors of each recording of a set, and the set's diagnosis."""
    rows = []
    for name, found in result["sets"].items():
        diagnosis, lines = found["diagnosis"], []
        for index, row in enumerate(found["rows"]):
            keys = ("static_mm", "rigid_lag_mm", "built_mm", "before_mm", "after_mm")
            use = "fitted" if row["fitted"] else "given" if row["record"] in diagnosis["records"] else "new"
            errors = [f"{row[key]:.3g}" for key in keys]
            seconds = f"{diagnosis['seconds']:.0f}" if index == 0 else ""
            lines.append([name if index == 0 else "", row["record"], use, *errors, seconds])
        rows.append((diagnosis["commit"], lines))
    header = [
        *("set", "record", "", "first shape stays", "nearest hand at its best lag", "as built"),
        *("refitted, no effect", "with what was named", "s"),
    ]
    said = [
        f"- {name}: {found['diagnosis']['outcome']}{_with_values(found['diagnosis']['effects'])}; "
        f"{found['diagnosis']['reason']}."
        for name, found in result["sets"].items()
    ]
    parts = [
        by_revision(header, rows, dates),
        "What the diagnoses say:",
        "\n".join(said),
        _measured_limits(result["sets"]),
    ]
    return "\n\n".join(part for part in parts if part)


def _measured_limits(sets: Mapping[str, Mapping[str, Any]]) -> str:
    """What recordings could have shown, and the motion of an arm that would show more of what they leave open."""
    told = {name: found["diagnosis"] for name, found in sets.items() if "limits" in found["diagnosis"]}
    if not told:
        return ""
    lines = [
        f"- {name}: {limits_in_words(diagnosis['limits'])}. {_next_motion(diagnosis['experiment'])}"
        for name, diagnosis in told.items()
    ]
    return "What these recordings would have named, and what an arm should do next:\n\n" + "\n".join(lines)


def _next_motion(experiment: Mapping[str, Any]) -> str:
    if "refused" in experiment:
        return f"No motion is proposed: {experiment['refused']}."
    return f"Next: {experiment['motion']}, which is expected to name {limits_in_words(experiment['after'])}."


def _with_values(effects: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Effects with the value and the interval of each parameter."""
    listed = (
        f"{effect}, "
        + ", ".join(f"{name} {value:.3g} ({low:.3g} to {high:.3g})" for name, (value, low, high) in values.items())
        for effect, values in effects.items()
    )
    return "".join(f"; {each}" for each in listed)


def named(effects: list[dict[str, Any]]) -> str:
    """The effects with their parameters and intervals."""
    return ", ".join(
        f"{effect['name']}: "
        + ", ".join(
            f"{name} {number['value']:.3g} ({number['ci95'][0]:.3g} to {number['ci95'][1]:.3g})"
            + ("" if number["unit"] == "1" else f" {number['unit']}")
            for name, number in effect["parameters"].items()
        )
        for effect in effects
    )


def simulation_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Spring updates a second, and what a second of a sheet costs at equal accuracy."""
    rows = [
        [name, f"{result[rate] / 1e6:.0f}", f"{ratio:.1f}"]
        for name, rate, ratio in (
            ("yardstick: one rollout, a spring per thread, atomic adds", "yardstick_updates_per_s", 1.0),
            ("16 rollouts, per core (CPU time)", "batched_updates_per_s_core", result["ratio_core_median"]),
            (
                "16 rollouts, two cores (elapsed time)",
                "batched_updates_per_s_machine",
                result["ratio_machine_median"],
            ),
        )
    ]
    cost = (
        f"A second of that sheet, hanging, within {1000 * result['equal_accuracy_error_m']:.2f} mm of the reference "
        f"with 667 substeps a frame, takes {result['equal_accuracy_substeps']} substeps a frame and "
        f"1/{1 / result['equal_accuracy_cost_ratio']:.0f} of the yardstick's CPU time. {result['cma_generations']} "
        f"generations of CMA-ES on the shipped episode ({result['cma_nodes']} nodes) take "
        f"{result['cma_minutes']:.1f} minutes."
    )
    header = ["2,000 nodes, 20,000 springs", "million spring updates/s", "ratio"]
    return f"{table(header, rows)}\n\n{cost}"


def accuracy_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Means over the episodes that a model was measured on, and what it changes of the coarse fit's there."""
    keys = ("train_cd_m", "test_cd_m", "train_te_m", "test_te_m")
    lines = []
    for kind in sorted({row["kind"] for row in result["accuracy"]}):
        of_kind = [row for row in result["accuracy"] if row["kind"] == kind]
        coarse = {row["episode"]: row["test_te_m"] for row in of_kind if row["model"] == "coarse"}
        for model in dict.fromkeys(row["model"] for row in of_kind):
            of_model = [row for row in of_kind if row["model"] == model]
            means = [_mean([row[key] for row in of_model]) for key in keys]
            cells = ["-" if mean is None else f"{1000 * mean:.1f}" for mean in means]
            changes = [row["test_te_m"] - coarse[row["episode"]] for row in of_model]
            changed = [f"{1000 * sum(changes) / len(changes):+.1f}", str(sum(change > 0 for change in changes))]
            minutes = f"{_mean([row['minutes'] for row in of_model]):.1f}"
            compared = ["", ""] if model == "coarse" else changed
            lines.append([kind, model, str(len(of_model)), *cells, *compared, minutes])
    header = ["kind", "model", "episodes", "train CD", "test CD", "train TE", "test TE", "test TE - coarse", "worse in"]
    return table([*header, "minutes"], lines)


def _mean(values: list[float | None]) -> float | None:
    numbers = [value for value in values if value is not None]
    return sum(numbers) / len(numbers) if numbers else None


def towel_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Errors of the fit over seeds, and of the baselines."""
    keys = ("train_chamfer_m", "test_chamfer_m", "train_track_m", "test_track_m")

    def row(name: str, scores: dict[str, Any]) -> list[str]:
        return [name, *("-" if scores[key] is None else f"{1000 * scores[key]:.1f}" for key in keys)]

    rows = [
        *(row(f"twin, seed {fit['seed']}", fit) for fit in result["fits"]),
        *(row(name, scores) for name, scores in result["baselines"].items()),
    ]
    return table([f"{result['generations']} generations (mm)", "train CD", "test CD", "train TE", "test TE"], rows)
