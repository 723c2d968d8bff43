"""Self-collision in whole rollouts: a folded sheet carries its flap and does not pass through itself."""

from functools import cache

import numpy as np
import pytest

from egophys_core.simulation import Rollout, RolloutBatch, batch_of_models, rollout
from tests.simulation.scenes import frame_times, moving_controls, sheet_model

SPACING = 0.02
SIDES = (16, 8)
FOLD_LINE = 0.62 * SPACING * (SIDES[0] - 1)
"""Metres along x; the flap beyond it comes to lie well within the rest."""
FOLDING = 1.5
"""Seconds."""
DISTANCE = 0.85 * SPACING
"""A node of one layer fits through a square of the other below 0.71 spacings."""


@cache
def flat_sheet() -> np.ndarray:
    """[N, 3] float32 metres, a little uneven."""
    x, y = np.meshgrid(*(np.arange(side) * SPACING for side in SIDES), indexing="ij")
    sheet = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    sheet[:, :2] += 0.02 * SPACING * np.random.default_rng(0).normal(size=(x.size, 2))
    return sheet.astype(np.float32)


def folding(*, stiffness: tuple[float, ...] = (100.0,), distances: tuple[float, ...] = (DISTANCE,)) -> RolloutBatch:
    """A hand takes the edge of a sheet on the table in an arc over the fold line, lets go and waits two seconds."""
    times = frame_times(FOLDING + 2.0, 1 / 30)
    angle = np.pi * (1 - np.cos(np.pi * np.clip(times / FOLDING, 0, 1))) / 2
    radius = SPACING * (SIDES[0] - 1) - FOLD_LINE
    height = radius * np.sin(angle) + 0.02 * np.clip(2 * angle / np.pi, 0, 1)
    grips = [0.0, 0.07, 0.14]
    path = np.stack(
        [np.stack([FOLD_LINE + radius * np.cos(angle), np.full_like(angle, y), height], axis=1) for y in grips], axis=1
    )
    hold = np.repeat((times < FOLDING)[:, None], len(grips), axis=1)
    models = [
        sheet_model(
            flat_sheet(),
            radius=1.5 * SPACING,
            stiffness=k,
            damping=0.05,
            controller_stiffness=100.0,
            controller_radius=1.2 * SPACING,
            collision_distance=distance,
        )
        for k, distance in zip(stiffness, distances, strict=True)
    ]
    return batch_of_models(models, [moving_controls(times, path, hold)] * len(models), ground_height=0.0)


def flap_heights(result: Rollout) -> np.ndarray:
    """[F, n] metres: the flap but for the nodes next to the fold, from when the hand has let go."""
    flap = flat_sheet()[:, 0] > FOLD_LINE + 2 * SPACING
    return result.positions[0][result.times > FOLDING + 0.1][:, flap, 2]


@pytest.mark.parametrize("stiffness", [100.0, 1000.0])
def test_a_folded_sheet_carries_its_flap(stiffness):
    result = rollout(folding(stiffness=(stiffness,)))
    result.raise_on_failure()
    heights = flap_heights(result)
    # A corner swings down when the hand lets go; it must not come out below.
    assert heights.min() > 0.25 * DISTANCE
    assert heights[-1].min() > 0.65 * DISTANCE
    assert heights[-1].max() < 1.1 * DISTANCE
    assert np.linalg.norm(result.velocities[0], axis=1).max() < 0.01


def test_without_self_collision_the_flap_sinks_into_the_sheet():
    result = rollout(folding(distances=(0.0,)))
    result.raise_on_failure()
    assert np.median(flap_heights(result)[-1]) < 0.05 * DISTANCE


def test_a_rollout_with_collisions_does_not_depend_on_its_batch():
    stiffness, distances = (100.0, 400.0, 150.0), (DISTANCE, 0.7 * DISTANCE, 0.0)
    together = rollout(folding(stiffness=stiffness, distances=distances))
    assert len(set(together.substeps.tolist())) > 1
    for row in range(len(stiffness)):
        alone = rollout(folding(stiffness=stiffness[row : row + 1], distances=distances[row : row + 1]))
        assert np.array_equal(together.positions[row], alone.positions[0])
        assert np.array_equal(together.velocities[row], alone.velocities[0])
