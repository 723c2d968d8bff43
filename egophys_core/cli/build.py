"""`egophys build EPISODE... --out TWIN`."""

import argparse
import dataclasses
import sys
from pathlib import Path

from egophys_core.cli.declared_arguments import add_declared_arguments
from egophys_core.cli.display import print_json, print_scores, progress_bar
from egophys_core.cli.marker_arguments import add_load_argument, loads_from
from egophys_core.cli.object_argument import add_object_argument, with_object
from egophys_core.cli.option_arguments import add_option_arguments, options_from
from egophys_core.cli.seed_argument import seed
from egophys_core.errors import OptionsError
from egophys_core.files import require_writable
from egophys_core.identification.options import FitOptions
from egophys_core.perception.options import PerceptionOptions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("episodes", nargs="+", type=Path, metavar="EPISODE", help=".mcap file or rosbag2 folder")
    parser.add_argument(
        "--source",
        choices=("auto", "points", "video"),
        default="auto",
        help="build from recorded points or from video; auto takes the points of a recording if it has any (default). "
        "Video is perceived with default options: for others run `egophys perceive` and build from what it writes",
    )
    add_object_argument(parser)
    add_declared_arguments(parser)
    parser.add_argument("--force", action="store_true", help="build from a video of which the verdict is poor, too")
    parser.add_argument("--out", required=True, type=Path, metavar="TWIN", help="twin file to write (.twin)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the search (default 0)")
    parser.add_argument(
        "--checkpoint",
        type=Path,
        metavar="FILE",
        help="keep the search in this file after every generation; if it is there, go on from it to the same twin",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    add_load_argument(parser)
    add_option_arguments(parser, FitOptions)


def run(parsed: argparse.Namespace) -> int:
    """Build and save."""
    from egophys_core.episode_source import PERCEPTION_SHARE, EpisodeSource, Source, is_video, load_episodes
    from egophys_core.identification import beside_baselines, build
    from egophys_core.identification.search_state import SEARCH_FILE
    from egophys_core.observation import observe_episodes
    from egophys_core.twin import TWIN_FILE, save_twin

    options = options_from(parsed, FitOptions)
    kept = [] if parsed.checkpoint is None else [parsed.checkpoint]
    for path in kept:
        require_writable(path, SEARCH_FILE, inputs=parsed.episodes)
    require_writable(parsed.out, TWIN_FILE, inputs=[*parsed.episodes, *kept])
    if parsed.object is not None and len(parsed.episodes) > 1:
        raise OptionsError("--object is a place in one video; perceive each of several by itself and build from those")
    options_of_video = with_object(PerceptionOptions(), parsed.object)
    source = EpisodeSource(
        source=Source(parsed.source),
        force=parsed.force,
        held=parsed.held,
        no_table=parsed.no_table,
        perception=options_of_video,
    )
    some_perceived = any(is_video(path, source) for path in parsed.episodes)
    if parsed.object is not None and not some_perceived:
        raise OptionsError(
            f"--object is a place in a video, but of {parsed.episodes[0]} the points are used; leave it out"
        )
    perceiving = PERCEPTION_SHARE if some_perceived else 0.0
    try:
        with progress_bar() as report:
            loaded = load_episodes(
                parsed.episodes, source, progress=lambda stage, share: report(stage, perceiving * share)
            )
            episodes = [each.episode for each in loaded]

            def show(stage: str, share: float, loss: float) -> None:
                report(stage, perceiving + (1 - perceiving) * share, f"loss {1000 * loss:.1f} mm")

            observed = observe_episodes(episodes, loads_from(parsed.load, [each.name for each in episodes]))
            twin = build(observed, options, seed=parsed.seed, progress=show, checkpoint=parsed.checkpoint)
    except KeyboardInterrupt:
        if parsed.checkpoint is None or not parsed.checkpoint.exists():
            raise
        print(f"egophys build: stopped; the same command goes on from {parsed.checkpoint}", file=sys.stderr)
        return 130
    save_twin(twin, parsed.out)
    reports = {each.episode.name: each.report for each in loaded if each.report is not None}
    scores, warning = beside_baselines(twin, observed[0])
    if parsed.json:
        named = {name: each.as_dict() for name, each in scores.items()}
        perception = {name: dataclasses.asdict(each) for name, each in reports.items()}
        print_json(
            {
                "twin": str(parsed.out),
                "twin_id": twin.twin_id,
                "scores": named,
                "warning": warning,
                "perception": perception,
            }
        )
    else:
        for name, perceived in reports.items():
            print(
                "\n".join(
                    (f"{name}: perceived from video, {perceived.verdict}", *(f"  {note}" for note in perceived.notes))
                )
            )
        print_scores(f"{episodes[0].name}", scores)
        for note in twin.provenance.settings.get("assumed", []):
            print(f"assumed: {note}")
        if warning:
            print(f"warning: {warning}")
        print(f"twin {twin.twin_id} written to {parsed.out}")
    return 0
