"""Diagnoses that may ask, as a table: what was said before and after asking, limits, and errors on another motion."""

import math
from collections.abc import Mapping, Sequence
from statistics import geometric_mean, median
from typing import Any

import numpy as np
from scipy.stats import kstest

from benchmarks.tables import table
from egophys_core.diagnosis.diagnosis import Outcome

Rows = list[dict[str, Any]]


def asked_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """Counts, and a row for each set."""
    rows = result["rows"]
    injected = [row for row in rows if row["effect"] != "none"]
    nothing = [row for row in rows if row["effect"] == "none"]
    header = (
        "injected",
        "size",
        "in a",
        "injected size",
        "passive: said",
        "limit",
        "asked",
        "said",
        "limit",
        "TE of a double lift before, after, with the true effect (mm)",
        "of a fold, a shake and a double pull",
        "s",
        "at",
    )
    lines = [
        [
            row["effect"],
            row["size"],
            row["object"],
            _figure(row["planted"]),
            _said(row["passive_outcome"], row["passive_named"]),
            _figure(row["passive_limit"]),
            "; ".join(row["motions"]) or "nothing",
            _said(row["outcome"], row["named"]),
            _figure(row["limit"]),
            _before_and_after([row]),
            "; ".join(_before_and_after([each]) for each in row.get("others", [])) or "-",
            f"{row['seconds']:.0f}",
            row["commit"],
        ]
        for row in (*injected, *nothing)
    ]
    return "\n\n".join([_counts(injected, nothing), table(header, lines), *_limits_reached(rows)])


LIMITS_WANTED = {
    "quadratic_drag": "3 1/m",
    "gravity_scale": "0.07",
    "gravity_tilt": "0.02 rad",
    "constant_body_force": "0.3 m/s^2",
    "uneven_mass": "0.15",
    "control_delay": "0.01 s",
    "grasp_slip": "0.002 m/s",
    "viscoelasticity": "0.3",
}
"""What asking aims at, by effect."""


def _limits_reached(rows: Rows) -> list[str]:
    """Medians over objects of the limits after asking, in the direction that shows least, and from where to where."""
    asked = [row for row in rows if row["motions"] and row.get("limits")]
    if not asked:
        return []
    objects = sorted({row["object"] for row in asked}, reverse=True)
    counts = {each: sum(row["object"] == each for row in asked) for each in objects}
    lines = [
        [
            name,
            aim,
            *(_spread([limit_of(row["limits"], name) for row in asked if row["object"] == each]) for each in objects),
        ]
        for name, aim in LIMITS_WANTED.items()
    ]
    told = "Limits reached by asking: median (least to largest) over objects, in the direction that shows least."
    return [told, table(("effect", "aim", *(f"{each} ({counts[each]})" for each in objects)), lines)]


def limit_of(limits: Sequence[Mapping[str, Any]], effect: str) -> float | None:
    """The size from which an effect would have been named in whatever direction; None where none is seen."""
    own = [each["size"] for each in limits if each["effect"] == effect]
    known = [each for each in own if each is not None]
    return max(known) if known and len(known) == len(own) else None


def _spread(limits: Sequence[float | None]) -> str:
    sizes = [math.inf if size is None else size for size in limits]
    middle, *ends = (_figure(size if math.isfinite(size) else None) for size in (median(sizes), min(sizes), max(sizes)))
    return f"{middle} ({' to '.join(ends)})"


def _counts(injected: Rows, nothing: Rows) -> str:
    parts = []
    for size in ("large", "small"):
        own = [row for row in injected if row["size"] == size]
        before, after = (sum(right(row, when) for row in own) for when in ("passive_", ""))
        parts.append(f"{after} of {len(own)} {size} ones after asking ({before} before)")
    invented = sum(bool(row["named"]) for row in nothing)
    beside = sum(right(row) and names_more(row) for row in injected)
    predicted = [row for row in injected if right(row) and row.get("others")]
    better, every = "", [each for row in predicted for each in (row, *row["others"])]
    if predicted:
        better = (
            f" What follows from a right name misses motions that had no part in it by {_before_and_after(every)} mm "
            f"before and after (sets: {len(predicted)}, errors: {len(every)}, geometric mean)."
        )
    compared = [each for each in every if each.get("track_true_m")]
    if compared:
        better += (
            f" Where the twin was refitted beside what was injected, too, it is {_before_and_after(compared)} mm "
            f"before, after and beside that (errors: {len(compared)})."
        )
    return (
        f"Named right, or in a complete ambiguous set: {' and '.join(parts)}; beside it something that was not "
        f"injected: {beside}. Names invented in {invented} of {len(nothing)} sets without an effect{_by_p(nothing)}."
        f"{better}{_by_limit(injected)}"
    )


def _by_p(nothing: Rows) -> str:
    """Whether p is what it says: as often below a number as that number is large."""
    if not nothing:
        return ""
    shares = np.array([row["p_null"] for row in nothing])
    even = kstest(shares, "uniform").pvalue
    structured = sum(Outcome(row["outcome"]) is Outcome.UNEXPLAINED for row in nothing)
    return (
        f", {structured} said to be unexplained; their p is below 0.05 in {sum(shares < 0.05)}, below 0.5 in "
        f"{sum(shares < 0.5)} of them (Kolmogorov and Smirnov's test of an even spread: {even:.2f})"
    )


def _by_limit(injected: Rows) -> str:
    """How many were named of those injected at so many times the limit that the diagnosis stated, before or after."""
    looks = [
        (row["planted"] / row[f"{when}limit"], right(row, when))
        for row in injected
        for when in ("passive_", "")
        if row["planted"] and row[f"{when}limit"] and (row["motions"] or not when)
    ]
    if not looks:
        return ""
    parts = [
        f"{sum(named for times, named in looks if low <= times < high)} of "
        f"{sum(low <= times < high for times, _ in looks)} {what}"
        for what, low, high in (
            ("injected at twice the limit that the diagnosis stated or more", 2.0, math.inf),
            ("from half of it to twice", 0.5, 2.0),
            ("at less", 0.0, 0.5),
        )
    ]
    return f" Of diagnoses, before asking and after, that state a limit, named: {', '.join(parts)}."


def right(row: Mapping[str, Any], when: str = "") -> bool:
    """Whether what was injected is named, alone or among what cannot be told apart."""
    return row["effect"] in row[f"{when}named"]


def names_more(row: Mapping[str, Any]) -> bool:
    """Whether something is said to be there beside one effect, or beside one set of those that look alike."""
    return Outcome(row["outcome"]) is not Outcome.AMBIGUOUS and len(row["named"]) > 1


def _said(outcome: str, named: list[str]) -> str:
    return f"{outcome}: {', '.join(named)}" if named else outcome


def _before_and_after(errors: Rows) -> str:
    """Geometric means, mm; also that beside what was injected, where it was measured."""
    known = [when for when in ("before", "after", "true") if all(each.get(f"track_{when}_m") for each in errors)]
    return ", ".join(f"{1e3 * geometric_mean(each[f'track_{when}_m'] for each in errors):.1f}" for when in known)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
