"""`egophys simulate TWIN EPISODE --out BAG`."""

import argparse
from dataclasses import replace
from pathlib import Path

from egophys_core.cli.marker_arguments import add_load_argument, load_of
from egophys_core.files import require_apart


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("twin", type=Path, metavar="TWIN")
    parser.add_argument("episode", type=Path, metavar="EPISODE", help=".mcap file or rosbag2 folder")
    add_load_argument(parser)
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="rosbag2 folder to write")


def run(parsed: argparse.Namespace) -> int:
    """Simulate and write."""
    import numpy as np

    from egophys_core.identification import predict
    from egophys_core.observation import place_twin
    from egophys_core.recording import read_episode, write_episode
    from egophys_core.twin import load_twin

    require_apart(parsed.out, [parsed.episode])
    twin, episode = load_twin(parsed.twin), read_episode(parsed.episode)
    problem = place_twin(twin, episode, load=load_of(parsed.load, episode.name))
    surface = predict(twin.model, problem)[:, twin.model.graph.surface]
    prediction = replace(
        problem.episode,
        name=f"{episode.name} predicted by {twin.twin_id}",
        points=surface,
        confidence=np.ones(surface.shape[:2], np.float32),
        point_ids=np.arange(surface.shape[1], dtype=np.uint32),
    )
    write_episode(prediction, parsed.out)
    print(f"{prediction.frames} frames of {surface.shape[1]} points written to {parsed.out}")
    return 0
