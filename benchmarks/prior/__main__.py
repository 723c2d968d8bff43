"""`python -m benchmarks.prior data`: make the set of rehearsed episodes, or what of it is missing."""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.prior.dataset import CHECKSUMS, FOLDER, make_set, warn_of_others
from egophys_core.files import write_json


def main() -> int:
    """Run the subcommand of the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.prior", description="A prior of stiffness.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    data = commands.add_parser("data", help="make the training and held-out episodes")
    data.add_argument("--out", type=Path, default=FOLDER, metavar="DIR", help=f"default {FOLDER}")
    data.add_argument(
        "--workers", type=int, choices=range(1, 9), default=2, metavar="N", help="episodes side by side; default 2"
    )
    data.add_argument("--record", action="store_true", help=f"write {CHECKSUMS.name} instead of comparing with it")
    data.set_defaults(run=_data)
    parsed = parser.parse_args()
    run: Callable[[argparse.Namespace], int] = parsed.run
    return run(parsed)


def _data(parsed: argparse.Namespace) -> int:
    began = time.perf_counter()

    def report(name: str, done: int, of: int) -> None:
        print(f"{done:3d} of {of}  {time.perf_counter() - began:6.0f} s  {name}", flush=True)

    checksums = make_set(parsed.out, workers=parsed.workers, report=report)
    if parsed.record:
        write_json(CHECKSUMS, checksums)
    else:
        warn_of_others(checksums)
    print(f"{len(checksums)} episodes in {parsed.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
