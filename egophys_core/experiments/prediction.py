"""What a twin predicts that would be recorded of a motion."""

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import PlanningError
from egophys_core.experiments.family import HandMotion
from egophys_core.geometry import about_vertical, farthest_points
from egophys_core.interpolation import values_at
from egophys_core.simulation import ContactKind, Controls, batch_of_models, rollout
from egophys_core.twin import ObjectModel

RATE_HZ = 30.0

POINTS = 150
"""Tracked points on the surface, at most."""


def predicted_episode(model: ObjectModel, motion: HandMotion, *, ground_height: float) -> Episode:
    """The motion as a tracker without noise would record it, of an object that begins as the twin was built.

    Raises:
        PlanningError: the twin cannot be simulated in it.
    """
    times = np.arange(1 + int(motion.duration * RATE_HZ)) / RATE_HZ
    hands = [
        values_at(each.times, each.positions, times)[:, None]
        + about_vertical(motion.hand_points, values_at(each.times, each.turns, times)[:, None])
        for each in motion.paths
    ]
    holds = [
        each.holds[np.clip(np.searchsorted(each.times, times, side="right") - 1, 0, len(each.times) - 1)]
        for each in motion.paths
    ]
    held = np.repeat(np.stack(holds, axis=1), len(motion.hand_points), axis=1)
    centres = np.concatenate(hands, axis=1).astype(np.float32)
    controls = Controls(
        times=times, positions=centres, contact=np.where(held, ContactKind.HOLD, ContactKind.NONE).astype(np.uint8)
    )
    result = rollout(batch_of_models([model], [controls], ground_height=ground_height))
    if result.failures[0] is not None:
        raise PlanningError(f"the twin cannot be simulated in {motion.name!r}: {result.failures[0]}")
    surface = result.positions[0][:, model.graph.surface]
    points = surface[:, farthest_points(surface[0], min(POINTS, surface.shape[1]))]
    return Episode(
        name=motion.name,
        times=times,
        points=points.astype(np.float32),
        confidence=np.ones(points.shape[:2], np.float32),
        point_ids=np.arange(points.shape[1], dtype=np.uint32),
        controllers=centres,
        controller_ids=np.arange(centres.shape[1], dtype=np.uint32),
        ground_height=ground_height,
        contact=held,
    )
