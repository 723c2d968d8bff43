"""`python -m benchmarks.prior COMMAND`: from seeds to the tables of the prior, one command a step.

`data` makes the episodes, `anchors` fits each coarsely, `train` learns from the training part, `measure` compares all
models on the rest; `python -m benchmarks.run prior` makes the tables of it. Each keeps what it has done and goes on
from there.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.prior.anchors import ANCHORS, make_anchors
from benchmarks.prior.dataset import CHECKSUMS, FOLDER, make_set, warn_of_others
from benchmarks.prior.items import Item, all_items
from benchmarks.prior.measure import CODEBOOK, ROWS, measure_all, measure_baselines
from benchmarks.prior.sequences import Split
from benchmarks.prior.tables import MODELS, TRAINED
from egophys_core.evaluation.baselines import BASELINES
from egophys_core.files import write_json


def main() -> int:
    """Run the subcommand of the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.prior", description="A prior of stiffness.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    data = commands.add_parser("data", help="make the training and held-out episodes")
    data.add_argument("--out", type=Path, default=FOLDER, metavar="DIR", help=f"default {FOLDER}")
    data.add_argument("--record", action="store_true", help=f"write {CHECKSUMS.name} instead of comparing with it")
    data.set_defaults(run=_data)
    anchors = commands.add_parser("anchors", help="fit every sequence coarsely, and refine the training ones densely")
    anchors.set_defaults(run=_anchors)
    train = commands.add_parser("train", help="train the prior that ships with the project, or an ablation")
    train.add_argument("--model", default=CODEBOOK, help=f"as the table names it; default {CODEBOOK}")
    train.add_argument("--passes", type=int, default=20, help="over all sequences; default 20")
    train.add_argument("--iterations", type=int, default=1, help="of each sequence in a pass; default 1")
    train.set_defaults(run=_train)
    measure = commands.add_parser("measure", help="compare models on the held-out episodes")
    measure.add_argument("--models", nargs="+", default=list(MODELS), help="as the table names them; default all")
    measure.add_argument("--only", choices=("paper", "rehearsed", "recorded"), help="a part of the held-out episodes")
    measure.set_defaults(run=_measure)
    for each in (anchors, train, measure):
        each.add_argument("--data", type=Path, default=FOLDER, metavar="DIR", help=f"the set; default {FOLDER}")
        each.add_argument("--anchors", type=Path, default=ANCHORS, metavar="DIR", help=f"default {ANCHORS}")
    for each, trained in ((train, FOLDER.parent / "trained"), (measure, TRAINED)):
        each.add_argument("--trained", type=Path, default=trained, metavar="DIR", help=f"default {trained}")
    for each in (data, anchors, measure):
        each.add_argument(
            "--workers", type=int, choices=range(1, 9), default=2, metavar="N", help="side by side; default 2"
        )
    parsed = parser.parse_args()
    action: Callable[[argparse.Namespace], int] = parsed.run
    return action(parsed)


def _reporter() -> Callable[[str, int, int], None]:
    began = time.perf_counter()

    def report(name: str, done: int, of: int) -> None:
        print(f"{done:3d} of {of}  {time.perf_counter() - began:6.0f} s  {name}", flush=True)

    return report


def _data(parsed: argparse.Namespace) -> int:
    checksums = make_set(parsed.out, workers=parsed.workers, report=_reporter())
    if parsed.record:
        write_json(CHECKSUMS, checksums)
    else:
        warn_of_others(checksums)
    print(f"{len(checksums)} episodes in {parsed.out}")
    return 0


def _anchors(parsed: argparse.Namespace) -> int:
    make_anchors(parsed.data, parsed.anchors, workers=parsed.workers, report=_reporter())
    return 0


def _train(parsed: argparse.Namespace) -> int:
    # Torch is needed here alone.
    from benchmarks.prior.train import MODELS as TRAINABLE
    from benchmarks.prior.train import train_model

    model = next((each for each in TRAINABLE if each.name == parsed.model), None)
    if model is None:
        sys.exit(f"no model is called {parsed.model!r}; there are {', '.join(each.name for each in TRAINABLE)}")
    rows = train_model(
        model, parsed.data, parsed.anchors, parsed.trained, passes=parsed.passes, iterations=parsed.iterations
    )
    for row in rows:
        print(json.dumps(row), flush=True)
    return 0


def _measure(parsed: argparse.Namespace) -> int:
    wanted: dict[str | None, Callable[[Item], bool]] = {
        None: lambda each: True,
        "paper": lambda each: each.paper,
        "rehearsed": lambda each: each.group == "rehearsed",
        "recorded": lambda each: each.group != "rehearsed",
    }
    items = [each for each in all_items(parsed.data) if each.split is Split.HELD_OUT and wanted[parsed.only](each)]
    models = [each for each in parsed.models if each not in BASELINES]
    measure_baselines(items)
    measure_all(
        items,
        models,
        anchors=parsed.anchors,
        trained=parsed.trained,
        rows=ROWS,
        workers=parsed.workers,
        report=_reporter(),
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
