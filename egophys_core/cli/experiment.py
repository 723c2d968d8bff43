"""`egophys experiment TWIN --out DIR`."""

import argparse
import time
from pathlib import Path
from typing import Any

from egophys_core.cli.asking_arguments import add_hand_arguments, hands_of
from egophys_core.cli.display import print_json, print_table, progress_bar
from egophys_core.errors import OptionsError
from egophys_core.files import require_new_folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("twin", type=Path, metavar="TWIN", help="as good as there is: the improved one of a diagnosis")
    parser.add_argument(
        "--diagnosis",
        type=Path,
        metavar="DIR",
        help="folder of a diagnosis of that object: what its recordings can show counts, what they left open is asked",
    )
    parser.add_argument(
        "--effects",
        nargs="+",
        default=[],
        metavar="EFFECT",
        help="effects to ask about, by name; by default those that the diagnosis left open, else all",
    )
    add_hand_arguments(parser)
    parser.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder to make: experiment.json, plan files, pictures"
    )
    parser.add_argument("--json", action="store_true", help="print the content of experiment.json instead of a summary")


def run(parsed: argparse.Namespace) -> int:
    """Choose, save and print."""
    from egophys_core.diagnosis.thresholds import Thresholds
    from egophys_core.effects import LIBRARY, effect_named
    from egophys_core.experiments import choose, save_experiment
    from egophys_core.experiments.open_questions import read_open_questions
    from egophys_core.twin import load_twin

    for name in parsed.effects:
        effect_named(name)
    hands = hands_of(parsed)
    require_new_folder(parsed.out)
    twin = load_twin(parsed.twin)
    questions = read_open_questions(parsed.diagnosis) if parsed.diagnosis else None
    asked = parsed.effects or (questions.effects if questions else list(LIBRARY))
    if not asked:
        raise OptionsError(f"the diagnosis in {parsed.diagnosis} leaves no effect open; name some with --effects")
    with progress_bar() as report:
        proposals = choose(
            twin,
            asked,
            hands,
            known=questions.limits if questions else (),
            rivals=questions.ambiguous if questions else (),
            needed_gain=Thresholds().least_gain,
            least_scale=questions.scale_m if questions else Thresholds().floor_m / 2.0,
            progress=report,
        )
    told = save_experiment(proposals, twin, parsed.out, stamp_ns=time.time_ns())
    if parsed.json:
        print_json(told)
    else:
        _print_summary(told, parsed.out)
    return 0


def _print_summary(told: dict[str, Any], folder: Path) -> None:
    from egophys_core.reporting import figures

    for number, motion in enumerate(told["motions"], start=1):
        print(f"{number}. {motion['sentence']} ({motion['seconds']:.0f} s)")
        before = {(each["effect"], each["parameter"]): each["size"] for each in motion["limits_before"]}
        print_table(
            "sizes from which effects could be named",
            ("effect", "parameter", "unit", "before", "with this motion", "looks like"),
            [
                (
                    each["effect"],
                    each["parameter"],
                    each["unit"],
                    figures(before.get((each["effect"], each["parameter"]))),
                    figures(each["size"]),
                    ", ".join(each["alike"]),
                )
                for each in motion["limits_after"]
            ],
        )
    names = " ".join(str(folder / plan) for plan in told["motions"][0]["plans"])
    print(f"plans and pictures in {folder}; try it: egophys rehearse --plan {names} --out tried")
