"""`egophys benchmark perception BAG...`, and `egophys benchmark prior` in a checkout of the project."""

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

from egophys_core.cli.board_arguments import add_board_arguments, board_from
from egophys_core.cli.display import print_json, print_table, progress_bar
from egophys_core.cli.option_arguments import add_option_arguments, options_from
from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.perception.options import PerceptionOptions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("what", choices=("perception", "prior"), help="what to measure")
    parser.add_argument(
        "bags",
        nargs="*",
        type=Path,
        metavar="BAG",
        help="of perception: with a video and /object/points; also compared if there: /truth/camera_pose, "
        "/truth/object_mask/compressed",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    add_board_arguments(parser, prefix="board-", placed=True)
    add_option_arguments(parser, PerceptionOptions)


def run(parsed: argparse.Namespace) -> int:
    """Perceive each bag and compare, or renew the tables of the prior.

    Returns:
        1 if perception refused a bag, whose row then says why; else 0.
    """
    if parsed.what == "prior":
        return _prior(parsed)
    if not parsed.bags:
        raise OptionsError("benchmark perception needs a bag: egophys benchmark perception BAG...")
    from egophys_core.cli.perception_benchmark import KEYS, measure, read_measured, video_name

    options, board = options_from(parsed, PerceptionOptions), board_from(parsed)
    # All are read first: one that cannot be compared is found before minutes of work on the others.
    measured = {bag: read_measured(bag) for bag in parsed.bags}
    rows: list[dict[str, Any]] = []
    for number, (bag, points) in enumerate(measured.items(), 1):
        with progress_bar() as report:
            note = f"{video_name(bag)}, {number} of {len(measured)}"
            try:
                row = measure(bag, points, options, board, lambda stage, share, note=note: report(stage, share, note))  # type: ignore[misc]
            except EpisodeError as error:
                row = {**dict.fromkeys(KEYS), "video": video_name(bag), "error": str(error)}
        rows.append(row)
    if parsed.json:
        print_json({"rows": rows})
    else:
        _print(rows)
    return int(any("error" in row for row in rows))


def _prior(parsed: argparse.Namespace) -> int:
    """Run the benchmark of the checkout that this is a part of: it is no part of the installed package."""
    checkout = Path(__file__).resolve().parents[2]
    if parsed.bags:
        raise OptionsError("benchmark prior takes no bags: it measures its own set (docs/prior.md)")
    if not (checkout / "benchmarks/prior").is_dir():
        raise OptionsError("benchmark prior needs a checkout of the project, which has benchmarks/prior")
    for step in ("prior data", "prior anchors", "prior measure", "run prior"):
        done = subprocess.run([sys.executable, "-m", *f"benchmarks.{step}".split()], cwd=checkout, check=False)
        if done.returncode:
            return done.returncode
    return 0


def _print(rows: list[dict[str, Any]]) -> None:
    columns = (
        ("mean mm", "mean_mm", 1),
        ("p95 mm", "p95_mm", 1),
        ("coverage", "coverage", 2),
        ("ids", "id_stability", 3),
        ("pose mm", "pose_mm", 2),
        ("pose deg", "pose_deg", 3),
        ("J", "mask_j", 3),
        ("F", "mask_f", 3),
        ("delta_avg", "track_delta_avg", 3),
        ("AJ", "track_aj", 3),
        ("OA", "track_oa", 3),
        ("s", "seconds", 0),
    )
    print_table(
        "perception against measured points (-: the bag has nothing to compare with)",
        ("video", *(name for name, _, _ in columns)),
        [
            (row["video"], *("-" if row[key] is None else f"{row[key]:.{digits}f}" for _, key, digits in columns))
            for row in rows
        ],
    )
    for row in rows:
        if "error" in row:
            print(f"{row['video']}: {row['error']}")
