"""Held-out error of the fit of the shipped towel episode over seeds, beside the two baselines."""

import time
from typing import Any

import numpy as np

from egophys_core.evaluation import baseline_scores
from egophys_core.identification import FitOptions, build
from egophys_core.observation import contact_flags, find_hands
from egophys_core.recording import read_episode

EPISODE = "examples/towel_lift.mcap"
GENERATIONS = 50
SEEDS = range(3)


def run() -> dict[str, Any]:
    """Fit with every seed; the keys of `results/towel.json`. Errors in metres."""
    episode = read_episode(EPISODE)
    rows = []
    for seed in SEEDS:
        began = time.process_time()
        scores = build([episode], FitOptions(generations=GENERATIONS), seed=seed).provenance.scores
        rows.append({"seed": seed, **scores, "cpu_minutes": (time.process_time() - began) / 60})
    baselines = baseline_scores(episode, contact_flags(episode, find_hands(episode)))
    named = {
        name: {key: value if np.isfinite(value) else None for key, value in scores.as_dict().items()}
        for name, scores in baselines.items()
    }
    return {"episode": EPISODE, "generations": GENERATIONS, "fits": rows, "baselines": named}
