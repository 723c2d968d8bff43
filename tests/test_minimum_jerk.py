"""The minimum-jerk law against its own derivatives."""

import numpy as np
import pytest

from egophys_core.minimum_jerk import PEAK_ACCELERATION, PEAK_SPEED, minimum_jerk


def test_it_goes_from_rest_to_rest_as_fast_as_it_says():
    tau = np.linspace(0.0, 1.0, 10_001)
    way = np.array([minimum_jerk(each) for each in tau])
    speed = np.gradient(way, tau, edge_order=2)
    acceleration = np.gradient(speed, tau, edge_order=2)
    assert (way[0], way[-1]) == (0.0, 1.0)
    assert [*speed[[0, -1]], *acceleration[[0, -1]]] == pytest.approx([0.0] * 4, abs=0.01)
    assert speed.max() == pytest.approx(PEAK_SPEED, rel=1e-5)
    assert np.abs(acceleration).max() == pytest.approx(PEAK_ACCELERATION, rel=1e-4)
