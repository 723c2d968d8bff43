"""`egophys replay LOG`."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from egophys_core.cli.display import print_json, print_table, progress_bar

if TYPE_CHECKING:
    from egophys_core.replay import Comparison


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("log", type=Path, metavar="LOG", help="rosbag2 folder or .mcap file")
    parser.add_argument("--twin-node", metavar="NAME", help="full name of the twin node (default: the log's twin_node)")
    parser.add_argument("--planner-node", metavar="NAME", help="of the planner (default: the log's mppi_planner_node)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")


def run(parsed: argparse.Namespace) -> int:
    """Replay and compare."""
    from egophys_core.replay import replay_log

    with progress_bar() as report:
        replay = replay_log(
            parsed.log,
            twin_node=parsed.twin_node,
            planner_node=parsed.planner_node,
            progress=lambda step, share, best: report(step, share, f"best {1000 * best:.1f} mm"),
        )
    if parsed.json:
        steps = [asdict(each) for each in replay.steps]
        print_json({"log": str(parsed.log), "good": replay.is_good, "steps": steps, "lost": replay.lost})
        return 0 if replay.is_good else 1
    print_table(
        f"replay of {parsed.log}",
        ("step", "outcome", "detail"),
        [(each.step, str(each.outcome), each.detail) for each in replay.steps],
    )
    for each in replay.steps:
        _show_difference(each)
    for sentence in replay.lost:
        print(f"lost: {sentence}")
    if not any(each.outcome in ("same", "different") for each in replay.steps):
        print("nothing could be compared: record the topics of config/recorder.yaml from before the build on")
    return 0 if replay.is_good else 1


def _show_difference(step: "Comparison") -> None:
    """Place, recorded value and replayed value, below each other and in full: one bit may be all that differs."""
    found = step.difference
    if found is None:
        return
    where = "" if found.index is None else f", {found.place} {found.index}"
    unit = f" {found.unit}" if found.unit else ""
    print(f"{step.step}: {found.quantity}{where}")
    for label, value in (("recorded", found.recorded), ("replayed", found.replayed)):
        print(f"  {label} {_words(value)}{unit}")


def _words(value: Any) -> str:
    return " ".join(map(repr, value)) if isinstance(value, list) else repr(value)
