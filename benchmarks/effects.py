"""What effects cost: CPU time of a batch with an effect over that of the same batch without, and threads it keeps busy.

16 rollouts of the towel of the shipped episode, in the second from where it is taken hold of.
"""

import os
import time
from dataclasses import replace
from typing import Any

import numpy as np

from egophys_core.effects import LIBRARY, Surroundings, TwinEffect
from egophys_core.identification import FitOptions, build
from egophys_core.observation.problem import FitProblem, prepare
from egophys_core.recording import read_episode
from egophys_core.simulation import RolloutBatch, batch_of_models, rollout
from egophys_core.twin import ObjectModel

EPISODE = "examples/towel_lift.mcap"
ROLLOUTS, FRAMES, ROUNDS = 16, 30, 5


def run() -> dict[str, Any]:
    """Measure; the keys of `results/effects.json`."""
    episode = read_episode(EPISODE)
    model = build([episode], FitOptions(generations=1), seed=0).model
    spacing = float(np.median(model.graph.rest_lengths))
    problem = prepare(episode, model.graph.positions, model.graph.surface, spacing=spacing)
    known = Surroundings(
        rest_positions=model.graph.positions.astype(np.float64),
        low=np.nanmin(episode.points, axis=(0, 1)),
        high=np.nanmax(episode.points, axis=(0, 1)),
        contact_begins=float(episode.times[problem.first_frame]),
        end=float(episode.times[-1]),
    )
    plain = _batch(model, problem)
    batches = {}
    for name, effect in LIBRARY.items():
        if effect.node_force or effect.spring_law:
            values = effect.starts(known)[0]
            batches[name] = _batch(replace(model, effects=(TwinEffect(name=name, values=values),)), problem)
    substeps = int(rollout(plain).substeps.max())
    return {
        "nodes": len(model.graph.positions),
        "springs": len(model.graph.springs),
        "rollouts": ROLLOUTS,
        "effects": {name: _compare(plain, batch, substeps) for name, batch in batches.items()},
    }


def _batch(model: ObjectModel, problem: FitProblem) -> RolloutBatch:
    """Equal rollouts from where the towel is taken hold of."""
    controls = problem.controls.part(slice(problem.first_frame, problem.first_frame + FRAMES + 1))
    ground = problem.episode.ground_height
    return batch_of_models(
        [model] * ROLLOUTS, [controls] * ROLLOUTS, starts=[problem.start] * ROLLOUTS, ground_height=ground
    )


def _compare(plain: RolloutBatch, batch: RolloutBatch, substeps: int) -> dict[str, float]:
    """Both by turns, as others use the machine as well: ratio of the least CPU times of a run on one core."""
    result = rollout(batch)
    result.raise_on_failure()
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        rounds = np.array([(_seconds(plain)[0], _seconds(batch)[0]) for _ in range(ROUNDS)])
    finally:
        os.sched_setaffinity(0, cores)
    least = rounds.min(axis=0)
    together = [_seconds(batch) for _ in range(2)]
    return {
        "cpu_ratio": float(least[1] / least[0]),
        "cpu_s": float(least[1]),
        "substeps_ratio": float(result.substeps.max() / substeps),
        "threads_busy": float(max(cpu / wall for cpu, wall in together)),
    }


def _seconds(batch: RolloutBatch) -> tuple[float, float]:
    """CPU time of all threads and elapsed time of a rollout."""
    cpu, wall = time.process_time(), time.perf_counter()
    rollout(batch)
    return time.process_time() - cpu, time.perf_counter() - wall
