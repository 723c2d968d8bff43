"""`egophys replay LOG`."""

import argparse
from dataclasses import asdict
from pathlib import Path

from egophys_core.cli.display import print_json, print_table, progress_bar

TWIN_NODE, PLANNER_NODE = "/twin_node", "/mppi_planner_node"
"""Those of `replay_log`, which is not loaded for `--help`."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("log", type=Path, metavar="LOG", help="rosbag2 folder or .mcap file")
    parser.add_argument("--twin-node", default=TWIN_NODE, help=f"name of the twin node (default {TWIN_NODE})")
    parser.add_argument("--planner-node", default=PLANNER_NODE, help=f"of the planner (default {PLANNER_NODE})")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")


def run(parsed: argparse.Namespace) -> int:
    """Replay and compare."""
    from egophys_core.replay import ReplayOutcome, replay_log

    with progress_bar() as report:
        comparisons = replay_log(
            parsed.log,
            twin_node=parsed.twin_node,
            planner_node=parsed.planner_node,
            progress=lambda step, share, best: report(step, share, f"best {1000 * best:.1f} mm"),
        )
    if parsed.json:
        print_json({"log": str(parsed.log), "steps": [asdict(each) for each in comparisons]})
    else:
        print_table(
            f"replay of {parsed.log}",
            ("step", "outcome", "detail"),
            [(each.step, str(each.outcome), each.detail) for each in comparisons],
        )
    return 1 if any(each.outcome == ReplayOutcome.DIFFERENT for each in comparisons) else 0
