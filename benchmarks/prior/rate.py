"""How often the codebook is asked: what every second frame differs from once a substep by, and what it saves.

The simulator asks every second frame of the controls at 30 Hz, and here every one. Controls with frames cut in parts,
along the same paths, have it ask more often; cut in as many parts as there are substeps, once a substep. The same is
done without a codebook, since cut paths of hands are not quite the same.
"""

import time
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from benchmarks.prior.anchors import AnchoredItem
from egophys_core.prior import with_prior
from egophys_core.simulation import Controls, batch_of_models, rollout
from egophys_core.simulation.batch import LONGEST_HELD
from egophys_core.twin import Codebook, ObjectModel

PARTS = (1, 1, 2, 5, 26)
"""Of a frame of 1/30 s, the first held for two; 26 is once a substep of the sheets and toys measured."""


def rates(anchored: list[AnchoredItem], codebook: Codebook) -> list[dict[str, Any]]:
    """A row for each number of parts: CPU seconds, and mean distance of nodes from those of once a substep, mm."""
    held = [LONGEST_HELD, *[0.0] * (len(PARTS) - 1)]
    found: list[dict[str, Any]] = [
        {"asked_per_frame": 0.5 * parts if seconds else parts} for parts, seconds in zip(PARTS, held, strict=True)
    ]
    for name in ("codebook", "uniform"):
        models = [with_prior(each.model, codebook)[0] if name == "codebook" else each.model for each in anchored]
        rolled = [
            [_roll(*pair, parts, seconds) for parts, seconds in zip(PARTS, held, strict=True)]
            for pair in zip(anchored, models, strict=True)
        ]
        for index, row in enumerate(found):
            apart = [np.linalg.norm(of_item[index][0] - of_item[-1][0], axis=2).mean() for of_item in rolled]
            row[f"{name}_seconds"] = float(np.mean([of_item[index][1] for of_item in rolled]))
            row[f"{name}_apart_mm"] = 1e3 * float(np.mean(apart))
    return found


def cut(controls: Controls, parts: int) -> Controls:
    """The same paths with every frame cut in parts."""
    times = np.concatenate(
        [
            np.linspace(begin, end, parts, endpoint=False)
            for begin, end in zip(controls.times[:-1], controls.times[1:], strict=True)
        ]
        + [controls.times[-1:]]
    )
    positions = controls.positions.astype(np.float64)
    path = CubicHermiteSpline(controls.times, positions, np.gradient(positions, controls.times, axis=0))
    frames = np.minimum(np.arange(len(times)) // parts, len(controls.times) - 1)
    return replace(controls, times=times, positions=path(times).astype(np.float32), contact=controls.contact[frames])


def _roll(anchored: AnchoredItem, model: ObjectModel, parts: int, longest_held: float) -> tuple[np.ndarray, float]:
    """Nodes [F, N, 3] at the frames of the record, and CPU seconds."""
    problem = anchored.problem
    controls = cut(problem.controls.part(slice(problem.first_frame, None)), parts)
    ground = anchored.episode.ground_height
    batch = batch_of_models([model], [controls], starts=[problem.start], ground_height=ground)
    if batch.codebook is not None:
        batch = replace(batch, codebook=replace(batch.codebook, longest_held=longest_held))
    began = time.process_time()
    result = rollout(batch)
    seconds = time.process_time() - began
    result.raise_on_failure()
    return result.positions[0, ::parts].astype(np.float64), seconds
