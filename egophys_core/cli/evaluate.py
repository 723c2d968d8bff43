"""`egophys evaluate TWIN EPISODE`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from egophys_core.cli.declared_arguments import add_declared_arguments, as_declared
from egophys_core.cli.display import print_json, print_scores, print_table
from egophys_core.cli.marker_arguments import add_load_argument, load_of

if TYPE_CHECKING:
    from egophys_core.evaluation import Scores


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("twin", type=Path, metavar="TWIN")
    parser.add_argument("episode", type=Path, metavar="EPISODE", help=".mcap file or rosbag2 folder")
    add_load_argument(parser)
    add_declared_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")


def run(parsed: argparse.Namespace) -> int:
    """Evaluate and print."""
    from egophys_core.evaluation import baseline_scores, lost_to, score
    from egophys_core.identification import predict
    from egophys_core.observation import observe_episode, place_twin
    from egophys_core.recording import read_episode
    from egophys_core.twin import load_twin

    twin, episode = load_twin(parsed.twin), as_declared(read_episode(parsed.episode), parsed)
    observed = observe_episode(episode, load=load_of(parsed.load, episode.name))
    problem = place_twin(twin, observed)
    scores = score(predict(twin.model, problem), twin.model.graph.surface, problem.episode)
    baselines = baseline_scores(observed.episode, observed.contact)
    warning = lost_to(scores, baselines, observed.episode)
    if parsed.json:
        print_json(
            {
                "twin_id": twin.twin_id,
                "episode": episode.name,
                **scores.as_dict(),
                "warning": warning,
                "baselines": {name: each.as_dict() for name, each in baselines.items()},
            }
        )
    else:
        predictions = {"twin": scores, **baselines}
        print_scores(f"{episode.name}, twin {twin.twin_id}", predictions)
        print_table(
            "both ways (two-way CD in mm; IoU of silhouettes, 1 is best)",
            ("prediction", "train CD", "test CD", "train IoU", "test IoU"),
            [(name, *_both_ways(each)) for name, each in predictions.items()],
        )
        if warning:
            print(f"warning: {warning}")
    return 0


def _both_ways(scores: "Scores") -> list[str]:
    """Cells of a row; a dash where there is no number."""
    distances = (1000 * scores.train_two_way_chamfer_m, 1000 * scores.test_two_way_chamfer_m)
    shown = [f"{value:.1f}" for value in distances] + [f"{value:.3f}" for value in (scores.train_iou, scores.test_iou)]
    return ["-" if value == "nan" else value for value in shown]
