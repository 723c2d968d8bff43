"""What a block of time says that the one before did not."""

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.innovations import innovations

PERSISTENCE = 0.8
"""Correlation of a patch's offset with that of the block before."""


def test_an_autoregressive_series_becomes_white_and_keeps_its_spread():
    random, count = np.random.default_rng(0), 20_000
    series = np.empty(count)
    series[0] = random.normal()
    for index in range(1, count):
        series[index] = PERSISTENCE * series[index - 1] + np.sqrt(1 - PERSISTENCE**2) * random.normal()
    found = innovations(np.repeat(series[None, :, None, None], 3, axis=3))[0, :, 0, 0]
    assert found.std() == pytest.approx(1.0, abs=0.02)
    assert np.corrcoef(found[:-1], found[1:])[0, 1] == pytest.approx(0.0, abs=0.02)


def test_an_offset_that_stays_counts_in_full_only_when_it_comes():
    means = np.zeros((1, 10, 1, 3))
    means[:, 4:] = 1.0
    found = innovations(means)[0, :, 0, 0]
    spread = np.sqrt(1 - PERSISTENCE**2)
    assert found == pytest.approx([0.0] * 4 + [1.0 / spread] + [(1.0 - PERSISTENCE) / spread] * 5)


def test_after_blocks_unseen_less_is_expected():
    means = np.full((1, 6, 1, 3), np.nan)
    means[:, [1, 4]] = 1.0
    found = innovations(means)[0, :, 0, 0]
    share = PERSISTENCE**3
    assert found[1] == 1.0
    assert found[4] == pytest.approx((1.0 - share) / np.sqrt(1.0 - share**2))
    assert np.isnan(found[[0, 2, 3, 5]]).all()


def test_each_row_is_as_if_alone():
    means = np.random.default_rng(1).normal(size=(3, 8, 4, 3))
    assert (innovations(means)[1:2] == innovations(means[1:2])).all()
    assert innovations(means[:0]).shape == (0, 8, 4, 3)
