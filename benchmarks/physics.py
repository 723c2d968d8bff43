"""What the physics is judged by: speed, cost at equal accuracy, minutes of a search, errors of all episodes."""

import time
from typing import Any

from benchmarks import accuracy, simulation
from egophys_core.identification import FitOptions, build
from egophys_core.recording import read_episode

EPISODE = "examples/towel_lift.mcap"


def run() -> dict[str, Any]:
    """Measure; the keys of `results/physics.json`. The speeds come first, while nothing else runs."""
    return {**simulation.run(), **_search(), "accuracy": accuracy.run()}


def _search() -> dict[str, Any]:
    """Elapsed minutes of the paper's 50 generations on a 7 s episode, on all cores."""
    episode, options = read_episode(EPISODE), FitOptions(dense_steps=0)
    began = time.perf_counter()
    twin = build([episode], options, seed=0)
    return {
        "cma_minutes": (time.perf_counter() - began) / 60,
        "cma_generations": options.generations,
        "cma_nodes": len(twin.model.graph.positions),
    }
