"""`egophys experiment TWIN --out DIR`."""

import argparse
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from egophys_core.cli.display import print_json, print_table, progress_bar
from egophys_core.errors import DiscrepancyError

if TYPE_CHECKING:
    from egophys_core.diagnosis.diagnosis import DetectionLimit

LEFT = 5
"""Effects that came nearest to being named, which are asked about if a diagnosis named none."""


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
    parser.add_argument(
        "--by",
        choices=("person", "arm"),
        default="person",
        help="who does it: a person with two hands, or one arm within the bridge's limits (default person)",
    )
    parser.add_argument(
        "--limits", type=Path, metavar="FILE", help="YAML of the arm's limits, as the bridge takes it (default its own)"
    )
    parser.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder to make: experiment.json, plan files, pictures"
    )
    parser.add_argument("--json", action="store_true", help="print the content of experiment.json instead of a summary")


def run(parsed: argparse.Namespace) -> int:
    """Choose, save and print."""
    from egophys_core.diagnosis.saving import require_new_folder
    from egophys_core.diagnosis.verdict.thresholds import Thresholds
    from egophys_core.effects import LIBRARY, effect_named
    from egophys_core.experiments import PERSON, HandLimits, choose, save_experiment
    from egophys_core.robot import MotionLimits
    from egophys_core.twin import load_twin

    for name in parsed.effects:
        effect_named(name)
    require_new_folder(parsed.out)
    twin, limits = load_twin(parsed.twin), PERSON
    if parsed.by == "arm":
        arm = MotionLimits.load(parsed.limits) if parsed.limits else MotionLimits()
        limits = HandLimits(hands=1, fastest_m_s=arm.max_speed_m_s, highest_m=arm.workspace_max_m[2])
    content = _content(parsed.diagnosis) if parsed.diagnosis else {}
    asked = parsed.effects or _left_open(content) or list(LIBRARY)
    with progress_bar() as report:
        proposals = choose(
            twin,
            asked,
            limits,
            known=_limits(content),
            rivals=_rivals(content),
            needed_gain=Thresholds().least_gain,
            least_scale=content["where"]["size_m"] if content else Thresholds().floor_m / 2.0,
            progress=report,
        )
    told = save_experiment(proposals, twin, parsed.out, stamp_ns=time.time_ns())
    if parsed.json:
        print_json(told)
    else:
        _print_summary(told, parsed.out)
    return 0


def _content(folder: Path) -> dict[str, Any]:
    """Of a diagnosis.

    Raises:
        DiscrepancyError: there is none, or one of an earlier version.
    """
    from egophys_core.diagnosis.saving import DIAGNOSIS_NAME

    path = folder / DIAGNOSIS_NAME
    try:
        content: dict[str, Any] = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise DiscrepancyError(f"cannot read {path}: {error}; give the folder that `egophys diagnose` made") from error
    if "limits" not in content:
        raise DiscrepancyError(f"{path}: it lacks detection limits, as one of an earlier version does; diagnose again")
    return content


def _limits(content: dict[str, Any]) -> "list[DetectionLimit]":
    from egophys_core.diagnosis.diagnosis import DetectionLimit

    return [DetectionLimit(**{**each, "alike": tuple(each["alike"])}) for each in content.get("limits", [])]


def _rivals(content: dict[str, Any]) -> list[str]:
    """Effects that a diagnosis could not tell apart."""
    if content.get("outcome") not in ("ambiguous", "named_and_ambiguous"):
        return []
    return [each["name"] for each in content["effects"] if each["name"] not in content["decisions"][-1]["beside"]]


def _left_open(content: dict[str, Any]) -> list[str]:
    """What a diagnosis could not tell apart, else what came nearest to being named."""
    if not content:
        return []
    named = {each["name"] for each in content["effects"]}
    near = [each["name"] for each in content["candidates"] if each["name"] not in named]
    return _rivals(content) or near[:LEFT]


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
