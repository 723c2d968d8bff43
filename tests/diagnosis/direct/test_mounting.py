"""What markers say beside where they were fixed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.diagnosis.direct.mounting import as_mounted, beside_mounting


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


def mounted_askew(degrees):
    """Nodes [F, N, 3] that swing about a clamp, how a record of three of them shows them, and the clamp."""
    random, clamp = np.random.default_rng(2), np.array([0.3, -0.1, 0.5])
    nodes = clamp + [0.1, 0.0, 0.0] + random.normal(scale=0.01, size=(40, 5, 3))
    turn = Rotation.from_rotvec(np.radians(degrees) * np.array([0.0, 0.6, 0.8]))
    return nodes, clamp + turn.apply((nodes - clamp).reshape(-1, 3)).reshape(nodes.shape), clamp


def test_a_record_is_compared_as_it_is_mounted():
    nodes, shown, clamp = mounted_askew(2.0)
    seen = shown[:, [4, 1, 2]].copy()
    seen[3, 1] = np.nan
    seen[25:] += 1.0
    found = as_mounted(nodes, np.array([4, 1, 2]), seen, clamp, 25)
    assert found == pytest.approx(shown, abs=1e-9)


def test_no_record_is_mounted_more_than_some_degrees_askew():
    nodes, shown, clamp = mounted_askew(20.0)
    found = as_mounted(nodes, np.array([0, 1, 2]), shown[:, :3], clamp, 40)
    turn = Rotation.align_vectors(found[0] - clamp, nodes[0] - clamp)[0]
    assert np.degrees(turn.magnitude()) == pytest.approx(5.0, abs=0.01)
