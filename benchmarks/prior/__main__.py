"""`python -m benchmarks.prior data`: make the set of rehearsed episodes, or what of it is missing."""

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.prior.anchors import ANCHORS, make_anchors
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
    anchors = commands.add_parser("anchors", help="fit every sequence coarsely, and refine the training ones densely")
    anchors.add_argument("--data", type=Path, default=FOLDER, metavar="DIR", help=f"the set; default {FOLDER}")
    anchors.add_argument("--out", type=Path, default=ANCHORS, metavar="DIR", help=f"default {ANCHORS}")
    anchors.add_argument("--workers", type=int, default=2, metavar="N", help="sequences side by side; default 2")
    anchors.set_defaults(run=_anchors)
    train = commands.add_parser("train", help="train the prior that ships with the project, or an ablation")
    train.add_argument("--data", type=Path, default=FOLDER, metavar="DIR", help=f"the set; default {FOLDER}")
    train.add_argument("--anchors", type=Path, default=ANCHORS, metavar="DIR", help=f"default {ANCHORS}")
    train.add_argument("--out", type=Path, default=ANCHORS.parent / "trained", metavar="DIR")
    train.add_argument("--model", default="codebook K=4", help="as the table names it; default codebook K=4")
    train.add_argument("--passes", type=int, default=20, help="over all sequences; default 20")
    train.add_argument("--iterations", type=int, default=1, help="of each sequence in a pass; default 1")
    train.set_defaults(run=_train)
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


def _anchors(parsed: argparse.Namespace) -> int:
    began = time.perf_counter()

    def report(name: str, done: int, of: int) -> None:
        print(f"{done:3d} of {of}  {time.perf_counter() - began:6.0f} s  {name}", flush=True)

    make_anchors(parsed.data, parsed.out, workers=parsed.workers, report=report)
    return 0


def _train(parsed: argparse.Namespace) -> int:
    # Torch is needed here alone.
    from benchmarks.prior.train import MODELS, train_model

    model = next((each for each in MODELS if each.name == parsed.model), None)
    if model is None:
        sys.exit(f"no model is called {parsed.model!r}; there are {', '.join(each.name for each in MODELS)}")
    rows = train_model(
        model, parsed.data, parsed.anchors, parsed.out, passes=parsed.passes, iterations=parsed.iterations
    )
    for row in rows:
        print(json.dumps(row), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
