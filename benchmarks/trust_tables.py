"""Results of `benchmarks/trust.py` as Markdown tables."""

from collections.abc import Mapping
from typing import Any

from benchmarks.revisions import described
from benchmarks.tables import table


def faults_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """What went wrong, what the arm did, what was published and what the user did."""
    rows = [
        [
            row["fault"],
            row["arm"] if row["held_still"] else "**moved on**",
            f"{'once' if row['reason_published_once'] else '**not once**'}: {row['published'] or 'nothing'}",
            row["user"],
            "yes" if row["recovered_without_restart"] else "**no**",
        ]
        for row in result["faults"]
    ]
    header = ["what went wrong", "what the arm did", "what was published", "what the user did", "without a restart"]
    return f"Measured at {described(result['measured']['faults']['commit'], dates)}:\n\n{table(header, rows)}"


def plans_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """What became of hostile plans."""
    outcomes = sorted(result["plan_outcomes"].items(), key=lambda item: -item[1])
    rows = [[str(result["plans_tried"]), *(str(count) for _, count in outcomes), str(result["unsafe_commands"])]]
    header = ["plans", *(name for name, _ in outcomes), "unsafe commands"]
    return f"Measured at {described(result['measured']['plans']['commit'], dates)}:\n\n{table(header, rows)}"


def stream_table(result: dict[str, Any], dates: Mapping[str, str]) -> str:
    """How even an hour of streaming is."""
    row = [
        f"{result['stream_hours']:.2f}",
        str(result["streamed_poses"]),
        f"{result['median_gap_ms']:.2f}",
        f"{result['worst_gap_ms']:.1f} ({result['worst_gap_of_ours_ms']:.1f})",
        f"{result['gaps_above_20_ms']} ({result['gaps_above_20_ms_of_ours']})",
        f"{result['memory_growth_mb']:.1f}",
    ]
    header = [
        "hours",
        "poses",
        "median gap (ms)",
        "worst gap, (ours) (ms)",
        "gaps above 20 ms, (ours)",
        "memory grew by (MB)",
    ]
    return f"Measured at {described(result['measured']['stream']['commit'], dates)}:\n\n{table(header, [row])}"
