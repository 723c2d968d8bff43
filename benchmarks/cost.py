"""Cost of a diagnosis over points, episodes and candidates: CPU time, and its ratio to a yardstick of the same run."""

import time
from collections.abc import Callable
from typing import Any

from benchmarks.injected import FIT
from benchmarks.yardstick import Yardstick
from egophys_core.diagnosis.diagnose import diagnose
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.effects import LIBRARY
from egophys_core.identification import build
from egophys_core.rehearsal.options import Motion, RehearsalOptions
from egophys_core.rehearsal.world import rehearse
from egophys_core.twin import ObjectModel

SUBSTEPS = 7 * 20_000
"""Of the yardstick: an episode's seven seconds, in the substeps of the paper."""

POINTS, EPISODES, CANDIDATES = (90, 180, 350), (1, 2, 4), (6, 12, 24)
"""Each is varied while the others stay at these: 180 points, two episodes, all candidates."""

MOTIONS = (Motion.LIFT, Motion.SHAKE, Motion.DOUBLE_LIFT, Motion.PULL)


def run() -> dict[str, Any]:
    """Measure; the keys of `results/cost.json`."""
    settings = {
        *((points, EPISODES[1], CANDIDATES[2]) for points in POINTS),
        *((POINTS[1], episodes, CANDIDATES[2]) for episodes in EPISODES),
        *((POINTS[1], EPISODES[1], candidates) for candidates in CANDIDATES),
    }
    return {"rows": [_measure(*each) for each in sorted(settings)]}


def _measure(points: int, episodes: int, candidates: int) -> dict[str, float]:
    """One sheet without an effect, diagnosed with the first so many candidates of the library."""
    recorded = [
        rehearse(RehearsalOptions(points=points), motion, seed=index, object_seed=300)
        for index, motion in enumerate(MOTIONS[:episodes])
    ]
    twin = build(recorded, FIT, seed=0)
    yardstick = _cpu_seconds(lambda: _advance_yardstick(twin.model))
    began = time.monotonic()
    cpu = _cpu_seconds(lambda: diagnose(twin, recorded, DiagnosisOptions(), without=tuple(LIBRARY)[candidates:]))
    return {
        "points": points,
        "nodes": len(twin.model.graph.positions),
        "episodes": episodes,
        "candidates": candidates,
        "elapsed_s": time.monotonic() - began,
        "cpu_s": cpu,
        "cpu_per_yardstick": cpu / yardstick,
    }


def _advance_yardstick(model: ObjectModel) -> None:
    """Simulate an episode of the object once, as simply as can be."""
    graph, parameters = model.graph, model.parameters
    mass = parameters.total_mass / len(graph.positions)
    yardstick = Yardstick(graph.positions, graph.springs, graph.rest_lengths, mass)
    yardstick.advance(SUBSTEPS, 7.0 / SUBSTEPS, parameters.stiffness, parameters.damping)


def _cpu_seconds(work: Callable[[], object]) -> float:
    """CPU time of all threads."""
    began = time.process_time()
    work()
    return time.process_time() - began
