"""Rolling out a batch: frames on the host, substeps in the kernels."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
import warp as wp
from scipy.sparse import coo_matrix

from egophys_core.cores import usable_cores
from egophys_core.errors import SimulationError
from egophys_core.lanes import LANES, group_count
from egophys_core.simulation.batch import RolloutBatch
from egophys_core.simulation.effect_rates import EffectRates
from egophys_core.simulation.engine import Engine
from egophys_core.simulation.frames import into_record, into_record_directions
from egophys_core.simulation.stability import LONGEST_SUBSTEP, stable_substeps
from egophys_core.simulation.turns import turn_on


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """What K rollouts did."""

    times: np.ndarray
    """[F] float64, seconds."""
    positions: np.ndarray
    """[K, F, N, 3] float32, metres, world, or the batch's frames; not finite from where a rollout diverged."""
    velocities: np.ndarray
    """[K, N, 3] float32, m/s, at the end."""
    substeps: np.ndarray
    """[K] int, most substeps any frame needed."""
    failures: tuple[str | None, ...]
    """Per rollout None, or what went wrong: node, time and likely cause."""

    def raise_on_failure(self) -> None:
        """Raise SimulationError for the first rollout that failed."""
        for index, failure in enumerate(self.failures):
            if failure is not None:
                raise SimulationError(f"rollout {index}: {failure}")


def filled_up(count: int) -> int:
    """As many rollouts as take no longer than `count` of them, 1 or more: those that fill the lanes of their groups."""
    return LANES * group_count(count)


def rollout(batch: RolloutBatch, *, longest_substep: float = LONGEST_SUBSTEP, device: str = "cpu") -> Rollout:
    """Advance all rollouts of a batch over the frames of their controls.

    On the CPU lane groups run on all cores; a rollout's numbers do not depend on the batch it is in.

    Args:
        longest_substep: seconds; stability may ask for shorter ones, a shorter one here is more accurate.
        device: a Warp device, "cpu" or "cuda:0".

    Raises:
        SimulationError: a rollout would need more than `MOST_SUBSTEPS_PER_SECOND` substeps a second.
    """
    if not wp.get_device(device).is_cpu:
        with turn_on(device):
            return in_frames(_run(batch, longest_substep, device), batch.frames)
    groups = group_count(batch.count)
    workers = min(groups, usable_cores())
    # Rollouts with similar substeps share a lane group: it runs as many as the one that needs most. Of those that need
    # as many, the ones with the same effects do.
    order = np.lexsort((_effects_code(batch), _fastest_rates(batch)))
    bounds = np.linspace(0, groups, workers + 1).astype(int) * LANES
    parts = [batch.part(order[first:last]) for first, last in pairwise(bounds)]
    with ThreadPoolExecutor(workers) as pool:
        results = list(pool.map(partial(_run, longest_substep=longest_substep, device=device), parts))
    back = np.argsort(order)
    failures = [failure for result in results for failure in result.failures]
    whole = Rollout(
        times=results[0].times,
        positions=np.concatenate([result.positions for result in results])[back],
        velocities=np.concatenate([result.velocities for result in results])[back],
        substeps=np.concatenate([result.substeps for result in results])[back],
        failures=tuple(failures[row] for row in back),
    )
    return in_frames(whole, batch.frames)


def in_frames(result: Rollout, frames: np.ndarray | None) -> Rollout:
    """The result, in the world so far, as each rollout's frame [K, 4, 4] records it."""
    if frames is None:
        return result
    return replace(
        result,
        positions=into_record(result.positions, frames).astype(np.float32),
        velocities=into_record_directions(result.velocities, frames).astype(np.float32),
    )


def _fastest_rates(batch: RolloutBatch) -> np.ndarray:
    """[K] substeps per second that each rollout needs, roughly: from the row sums of M^-1 K and of its damping."""
    springs = len(batch.springs)
    ends = (batch.springs.ravel(), np.repeat(np.arange(springs), 2))
    touching = coo_matrix((np.ones(2 * springs), ends), shape=(batch.masses.shape[1], springs)).tocsr()
    stiff, damped = (
        2 * ((touching @ weights.T).T / batch.masses).max(axis=1) for weights in (batch.stiffness, batch.damping)
    )
    added = EffectRates(batch).at_rest()
    return stable_substeps(1.0, stiff * added.factor + added.stiffness, damped + added.damping)


def _effects_code(batch: RolloutBatch) -> np.ndarray:
    """[K] a number for each choice of effects."""
    code = np.zeros(batch.count, int)
    for each in batch.effects:
        code = 2 * code + each.present
    return code


def _run(batch: RolloutBatch, longest_substep: float, device: str) -> Rollout:
    return advance_all(Engine(batch, device, longest_substep=longest_substep))


def advance_all(engine: Engine, before_frame: Callable[[], None] = lambda: None) -> Rollout:
    """Advance an engine over all frames of its batch, or until every rollout has diverged."""
    count, frames = engine.batch.count, len(engine.times)
    positions = np.full((count, frames, engine.nodes, 3), np.nan, np.float32)
    positions[:, 0] = engine.batch.positions
    for frame in range(frames - 1):
        before_frame()
        engine.advance_frame(frame)
        running = [failure is None for failure in engine.failures]
        if not any(running):
            break
        positions[running, frame + 1] = engine.node_positions()[running]
    return Rollout(
        times=engine.times,
        positions=positions,
        velocities=engine.node_velocities().astype(np.float32),
        substeps=np.max([segment.substeps for segment in engine.segments], axis=0),
        failures=tuple(engine.failures),
    )
