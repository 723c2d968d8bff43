"""Residuals: what observers leave unexplained, as what is new in means over patches of the object and blocks of time.

Means over a patch and a fifth of a second carry what missing physics does; what is left of the tracks' noise in them
is a tenth of its size at a track.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from egophys_core.cores import usable_cores
from egophys_core.diagnosis.direct.mounting import beside_mounting
from egophys_core.diagnosis.evidence.innovations import innovations
from egophys_core.diagnosis.evidence.observer import TrackNudging
from egophys_core.diagnosis.tracked_episode import PATCHES, TrackedEpisode
from egophys_core.simulation import LANES, batch_of_models, rollout
from egophys_core.twin import ObjectModel

BATCH = 32
"""Models that are simulated together: a bound on memory."""

FEWEST_IN_BLOCK = 4
"""Seen track positions below which a block of a patch has no mean."""

Job = tuple[TrackedEpisode, Sequence[ObjectModel]]
"""Rollouts that are simulated together: in an episode, of some models."""


def track_offsets(observation: TrackedEpisode, models: Sequence[ObjectModel]) -> tuple[np.ndarray, np.ndarray]:
    """Where each model's observer leaves the tracks unexplained.

    Returns:
        [K, T - touched, P, 3] metres, measured minus twin, NaN where unseen; and [K] bool, which rollouts diverged.
    """
    problem, count = observation.problem, len(models)
    batch = batch_of_models(
        models,
        [observation.controls()] * count,
        starts=[problem.start] * count,
        velocities=[problem.velocities] * count,
        ground_height=problem.episode.ground_height,
    )
    # Free rollouts are not nudged.
    if not observation.free:
        nudging = TrackNudging(observation.tracks, problem.episode.times, rate=observation.rate)
        batch = replace(batch, nudging=nudging)
    result = rollout(batch)
    measured = observation.tracks.positions[observation.touched :]
    offsets = np.stack([measured - observation.tracks.on_twin(positions) for positions in result.positions])
    return offsets, np.array([failure is not None for failure in result.failures])


def block_means(observation: TrackedEpisode, offsets: np.ndarray) -> np.ndarray:
    """[K, B, Q, 3] metres: offsets [K, T - touched, P, 3] averaged over cells; NaN where too few tracks are seen."""
    cells = observation.blocks[:, None] * PATCHES + observation.patches[None]
    seen = np.isfinite(observation.tracks.positions[observation.touched :]).all(axis=2)
    cell, size = cells[seen], observation.block_count * PATCHES
    counts = np.bincount(cell, minlength=size)
    means = np.full((len(offsets), size, 3), np.nan)
    enough = counts >= FEWEST_IN_BLOCK
    for row, offset in enumerate(offsets):
        values = offset[seen]
        sums = np.stack([np.bincount(cell, weights=values[:, axis], minlength=size) for axis in range(3)], axis=1)
        means[row, enough] = sums[enough] / counts[enough, None]
    return means.reshape(len(offsets), observation.block_count, PATCHES, 3)


def acceleration(observations: Sequence[TrackedEpisode]) -> float:
    """Metres that an observer leaves of an acceleration a which its twin lacks altogether, a / w^2.

    Of the second differences of patches' places from block to block, root mean square; 0 where nothing is nudged.
    """
    squares = [np.zeros(0)]
    for each in observations:
        if not each.free:
            (places,) = block_means(each, each.tracks.positions[None, each.touched :])
            # The last block may have fewer frames, so that middles are not quite equally far apart.
            middles = np.bincount(each.blocks, each.episode.times[each.touched :]) / np.bincount(each.blocks)
            apart = np.diff(middles)[:, None, None]
            changes = 2.0 * np.diff(np.diff(places, axis=0) / apart, axis=0) / (apart[1:] + apart[:-1])
            squares.append((changes[np.isfinite(changes)] / each.rate**2) ** 2)
    every = np.concatenate(squares)
    return float(np.sqrt(every.mean())) if every.size else 0.0


def residuals(
    observations: Sequence[TrackedEpisode],
    models: Sequence[ObjectModel],
    *,
    progress: Callable[[float], None] = lambda share: None,
) -> list[np.ndarray]:
    """Per episode [K, B, Q, 3] metres: what is new in each model's observer, or off in its free rollout; infinite where
    it diverged.

    Args:
        progress: called with the share done; may raise to stop.
    """
    size = _rollouts_together(len(observations), len(models))
    parts = [models[first : first + size] for first in range(0, len(models), size)]
    found = _side_by_side([(each, part) for part in parts for each in observations], progress)
    of_parts = [found[first : first + len(observations)] for first in range(0, len(found), len(observations))]
    return [np.concatenate(each) for each in zip(*of_parts, strict=True)]


def _side_by_side(jobs: Sequence[Job], progress: Callable[[float], None] = lambda share: None) -> list[np.ndarray]:
    """Per job [K, B, Q, 3] metres. `progress` may raise to stop: nothing is begun any more."""
    found: list[np.ndarray] = []
    with ThreadPoolExecutor(usable_cores()) as pool:
        try:
            for each in pool.map(lambda job: _left_in_blocks(job[0], *track_offsets(*job)), jobs):
                found.append(each)
                progress(len(found) / len(jobs))
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    return found


def _rollouts_together(episodes: int, models: int) -> int:
    """How many models of an episode are simulated together: whole lane groups, so that no core idles at last."""
    groups = -(-min(models, BATCH) // LANES)
    shares = 1 if episodes % usable_cores() == 0 else usable_cores()
    return LANES * max(1, -(-groups // shares))


def _left_in_blocks(observation: TrackedEpisode, offsets: np.ndarray, diverged: np.ndarray) -> np.ndarray:
    means = block_means(observation, offsets)
    found = np.full_like(means, np.inf)
    if not observation.free:
        means = innovations(means)
    elif observation.mounted:
        means = beside_mounting(means)
    found[~diverged] = means[~diverged]
    return found
