"""What markers say beside where they were fixed."""

import numpy as np
import pytest

from egophys_core.diagnosis.direct.mounting import beside_mounting


def test_of_a_mean_a_share_is_left_and_what_moves_stays():
    random = np.random.default_rng(0)
    ring_down = random.normal(size=(2, 50, 3, 3))
    ring_down -= ring_down.mean(axis=1, keepdims=True)
    found = beside_mounting(ring_down + 0.01)
    assert found.mean(axis=1) == pytest.approx(0.2 * 0.01)
    assert found - found.mean(axis=1, keepdims=True) == pytest.approx(ring_down)


def test_unseen_blocks_stay_unseen_and_count_nothing():
    means = np.full((1, 6, 2, 3), np.nan)
    means[:, [1, 4], 0] = 1.0
    found = beside_mounting(means)
    assert found[:, [1, 4], 0] == pytest.approx(0.2)
    assert (np.isfinite(found) == np.isfinite(means)).all()


def test_each_row_is_as_if_alone():
    means = np.random.default_rng(1).normal(size=(3, 8, 4, 3))
    assert (beside_mounting(means)[1:2] == beside_mounting(means[1:2])).all()
    assert beside_mounting(means[:0]).shape == (0, 8, 4, 3)
