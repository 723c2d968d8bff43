"""`egophys diagnose TWIN EPISODE... --out DIR`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from egophys_core.cli.asking_arguments import add_ask_arguments, check_ask, hands_of, rehearsed_world
from egophys_core.cli.declared_arguments import add_declared_arguments, as_declared
from egophys_core.cli.display import print_json, print_table, progress_bar
from egophys_core.cli.marker_arguments import add_load_argument, loads_from
from egophys_core.cli.option_arguments import add_option_arguments, options_from
from egophys_core.cli.seed_argument import seed
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.files import require_apart, require_new_folder

if TYPE_CHECKING:
    from egophys_core.diagnosis.diagnosis import Diagnosis


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("twin", type=Path, metavar="TWIN")
    parser.add_argument(
        "episodes",
        nargs="+",
        type=Path,
        metavar="EPISODE",
        help=".mcap file or rosbag2 folder; two motions or more, to tell the object from the motion; of three or more "
        "the last third is not fitted: what is named has to show there, too",
    )
    parser.add_argument(
        "--out",
        required=True,
        type=Path,
        metavar="DIR",
        help="folder to make, with diagnosis.json, improved.twin and report.html",
    )
    parser.add_argument(
        "--report-on",
        nargs="+",
        default=[],
        type=Path,
        metavar="EPISODE",
        help="further episodes of the object, which have no part in what is found: errors are reported on them",
    )
    parser.add_argument(
        "--without", nargs="+", default=[], metavar="EFFECT", help="effects of the library to leave out, by name"
    )
    parser.add_argument("--seed", type=seed, default=0, help="of surrogates and resamples (default 0)")
    parser.add_argument("--json", action="store_true", help="print the content of diagnosis.json instead of a summary")
    add_load_argument(parser)
    add_ask_arguments(parser)
    add_declared_arguments(parser)
    add_option_arguments(parser, DiagnosisOptions)


def run(parsed: argparse.Namespace) -> int:
    """Diagnose, save and print."""
    from egophys_core.diagnosis.diagnosis import Outcome
    from egophys_core.diagnosis.saving import save_finding
    from egophys_core.effects import effect_named
    from egophys_core.experiments import diagnose_and_ask
    from egophys_core.recording import read_episode
    from egophys_core.twin import load_twin

    options = options_from(parsed, DiagnosisOptions)
    for name in parsed.without:
        effect_named(name)
    check_ask(parsed)
    hands = hands_of(parsed)
    require_apart(parsed.out, [*parsed.episodes, *parsed.report_on])
    require_new_folder(parsed.out)
    recorded = parsed.out.with_name(f"{parsed.out.name}_asked")
    if parsed.ask:
        require_new_folder(recorded)
    twin = load_twin(parsed.twin)
    world = rehearsed_world(parsed.world, twin, recorded) if parsed.ask else None
    episodes, others = (
        [as_declared(read_episode(path), parsed) for path in paths] for paths in (parsed.episodes, parsed.report_on)
    )
    with progress_bar() as report:
        answer = diagnose_and_ask(
            twin,
            episodes,
            options,
            world,
            most=parsed.ask,
            limits=hands,
            loads=loads_from(parsed.load, [each.name for each in (*episodes, *others)]),
            report_on=others,
            without=parsed.without,
            seed=parsed.seed,
            progress=report,
        )
    finding = answer.finding
    files = save_finding(finding, parsed.out)
    diagnosis = finding.diagnosis
    if parsed.json:
        print_json(diagnosis.as_dict())
    else:
        for number, each in enumerate(answer.asked, start=1):
            was, sentence = each.before.diagnosis, each.proposal.motion.sentence
            print(f"asked {number}, as {was.outcome} ({was.reason}): {sentence}")
        if parsed.ask:
            print(f"asked no more: {answer.ended}")
        _print_summary(diagnosis)
        print(f"improved twin {finding.twin.twin_id} in {files['twin']}; look at {files['report']}")
        if diagnosis.outcome != Outcome.NAMED:
            print(f"a motion that shows more: egophys experiment {files['twin']} --diagnosis {parsed.out} --out DIR")
    return 0 if diagnosis.outcome == Outcome.NONE else 1


def _print_summary(diagnosis: "Diagnosis") -> None:
    from egophys_core.diagnosis.saving import effect_texts
    from egophys_core.reporting import headline, limits_in_words

    content = diagnosis.as_dict()
    print(f"{diagnosis.outcome}: {headline(content, effect_texts())}")
    print(f"why: {diagnosis.reason}")
    _print_decision(content["decisions"][-1])
    print(f"could have been named: {limits_in_words(content['limits'])}")
    if diagnosis.experiment:
        print(f"next: {diagnosis.experiment}")
    for effect in content["effects"]:
        agree = "episodes agree" if effect["episodes_agree"] else "episodes do not agree"
        print_table(
            f"{effect['name']} ({agree})",
            ("parameter", "value", "95 % interval", "unit"),
            [_parameter(name, each) for name, each in effect["parameters"].items()],
        )
    print_table(
        "error in mm, before and after (TE track error, CD Chamfer distance;\n"
        "held: TE with the last residual held; follow: TE of points that move with the nearest hand at its best lag;\n"
        "new: an episode that was not fitted)",
        ("episode", "TE before", "TE after", "held", "follow", "CD before", "CD after"),
        [_error(each) for each in content["error"]],
    )


def _print_decision(decision: dict[str, Any]) -> None:
    """Which criterion made the outcome of the last search, and, where it named nothing, what came nearest."""
    from egophys_core.reporting import decision_in_words, miss_in_words

    print(f"decided: {decision_in_words(decision)}")
    for each in decision["nearest_misses"]:
        print(f"  nearest miss: {miss_in_words(each)}")


def _parameter(name: str, estimate: dict[str, Any]) -> tuple[str, ...]:
    from egophys_core.reporting import figures

    low, high = estimate["ci95"]
    return name, figures(estimate["value"]), f"{figures(low)} .. {figures(high)}", estimate["unit"]


def _error(error: dict[str, Any]) -> tuple[str, ...]:
    from egophys_core.reporting import millimetres

    names = (
        *("track_before_m", "track_after_m", "last_residual_track_m", "follow_track_m"),
        *("chamfer_before_m", "chamfer_after_m"),
    )
    fitted = "fitted" if error["fitted"] else "new"
    return f"{error['episode']} ({fitted})", *(millimetres(error[name]) for name in names)
