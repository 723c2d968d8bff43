"""Spring updates per second of CPU time: the batched simulator against the yardstick, in the same run.

A spring update is one spring of one rollout over one substep. CPU time counts all threads of the process, so the
batched figure is per core; the machine's figure uses elapsed time.
"""

import time
from collections.abc import Callable
from statistics import median

import numpy as np

from benchmarks.yardstick import Yardstick
from egophys_core.simulation import Controls, RolloutBatch, rollout
from egophys_core.twin import PhysicalParameters, connect

NODES, SPRINGS, ROLLOUTS = 2000, 20_000, 16
RUNS = 5
STIFFNESS, DAMPING, MASS = 10.0, 1e-3, 1e-4
FRAMES = 31
YARDSTICK_SUBSTEPS = 500


def run() -> dict[str, float]:
    """Measure; the keys of `results/simulation.json`."""
    positions, springs, rest_lengths = _sheet()
    batch = _batch(positions, springs, rest_lengths)
    yardstick = Yardstick(positions, springs, rest_lengths, MASS)
    rollout(batch)
    yardstick.advance(1, 1e-4, STIFFNESS, DAMPING)

    batched = _measure(lambda: len(springs) * ROLLOUTS * int(rollout(batch).substeps.max()) * (FRAMES - 1))

    def advance() -> int:
        yardstick.advance(YARDSTICK_SUBSTEPS, 1e-4, STIFFNESS, DAMPING)
        return len(springs) * YARDSTICK_SUBSTEPS

    reference = _measure(advance)
    return {
        "yardstick_updates_per_s": reference[0],
        "batched_updates_per_s_core": batched[0],
        "batched_updates_per_s_machine": batched[1],
        "ratio_core": batched[0] / reference[0],
        "ratio_machine": batched[1] / reference[0],
    }


def _measure(work: Callable[[], int]) -> tuple[float, float]:
    """Median updates per second of CPU time and of elapsed time over `RUNS` runs."""
    per_cpu, per_wall = [], []
    for _ in range(RUNS):
        cpu, wall = time.process_time(), time.perf_counter()
        updates = work()
        per_cpu.append(updates / (time.process_time() - cpu))
        per_wall.append(updates / (time.perf_counter() - wall))
    return median(per_cpu), median(per_wall)


def _sheet() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes strewn over a square metre, 3 m up, in an order that keeps neighbours near in memory; springs between."""
    generator = np.random.default_rng(0)
    positions = generator.random((NODES, 3)) * [1.0, 1.0, 0.02] + [0.0, 0.0, 3.0]
    cell = (positions[:, :2] * 16).astype(int)
    positions = positions[np.lexsort((cell[:, 1], cell[:, 0]))].astype(np.float32)
    springs = connect(positions, radius=1.0, max_neighbours=20)
    springs = springs[np.sort(generator.permutation(len(springs))[:SPRINGS])]
    return positions, springs, np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1)


def _batch(positions: np.ndarray, springs: np.ndarray, rest_lengths: np.ndarray) -> RolloutBatch:
    parameters = PhysicalParameters(stiffness=STIFFNESS, damping=DAMPING, controller_stiffness=STIFFNESS)
    controls = Controls(
        times=np.arange(FRAMES) / 30,
        positions=np.zeros((FRAMES, 1, 3), np.float32),
        hold=np.zeros((FRAMES, 1), bool),
    )
    shape = (ROLLOUTS, len(springs))
    return RolloutBatch(
        springs=springs,
        stiffness=np.full(shape, STIFFNESS, np.float32),
        damping=np.full(shape, DAMPING, np.float32),
        rest_lengths=np.tile(rest_lengths, (ROLLOUTS, 1)).astype(np.float32),
        masses=np.full((ROLLOUTS, NODES), MASS, np.float32),
        positions=np.tile(positions, (ROLLOUTS, 1, 1)),
        velocities=np.zeros((ROLLOUTS, NODES, 3), np.float32),
        parameters=(parameters,) * ROLLOUTS,
        controls=(controls,) * ROLLOUTS,
        flat=True,
        ground_height=0.0,
    )
