"""`egophys evaluate TWIN EPISODE`."""

import argparse
from pathlib import Path

from egophys_core.cli.display import print_json, print_scores
from egophys_core.evaluation import baseline_scores
from egophys_core.identification import evaluate_twin, find_hands, hold_flags
from egophys_core.recording import read_episode
from egophys_core.twin import load_twin

NAME = "evaluate"
HELP = "Errors of a twin on an episode of its object: train, test and all frames."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("twin", type=Path, metavar="TWIN")
    parser.add_argument("episode", type=Path, metavar="EPISODE", help=".mcap file or rosbag2 folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")


def run(parsed: argparse.Namespace) -> int:
    """Evaluate and print."""
    twin, episode = load_twin(parsed.twin), read_episode(parsed.episode)
    scores, _ = evaluate_twin(twin, episode)
    baselines = baseline_scores(episode, hold_flags(episode, find_hands(episode)))
    if parsed.json:
        print_json(
            {
                "twin_id": twin.twin_id,
                "episode": episode.name,
                **scores.as_dict(),
                "baselines": {name: each.as_dict() for name, each in baselines.items()},
            }
        )
    else:
        print_scores(f"{episode.name}, twin {twin.twin_id}", {"twin": scores, **baselines})
    return 0
