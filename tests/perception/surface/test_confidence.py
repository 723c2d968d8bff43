"""Confidence falls with motion that nobody sees."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from egophys_core.perception.surface.confidence import HALF_M, PointConfidence, growth_sigma


def grid() -> np.ndarray:
    x, y = np.meshgrid(np.arange(8) * 0.01, np.arange(8) * 0.01)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(64)])


SURE, SEEN, HIDDEN = np.full(64, 1e-4), np.ones(64, bool), np.zeros(64, bool)


def test_seen_and_sure_points_are_trusted() -> None:
    assert PointConfidence(grid()).next(grid() + 0.3, SURE, SEEN).min() > 0.99


def test_deviation_of_half_gives_a_half() -> None:
    found = PointConfidence(grid()).next(grid(), np.full(64, HALF_M), SEEN)
    np.testing.assert_allclose(found, 0.5)


def test_hidden_points_that_stand_are_trusted_for_a_second() -> None:
    confidence = PointConfidence(grid())
    for _ in range(30):
        found = confidence.next(grid(), SURE, HIDDEN)
    assert found.min() > 0.9


def test_hidden_points_that_move_are_not() -> None:
    confidence = PointConfidence(grid())
    previous = np.ones(64)
    for step in range(1, 18):
        found = confidence.next(grid() + [0.004 * step, 0, 0], SURE, HIDDEN)
        assert (found < previous).all()
        previous = found
    assert found.max() < 0.2


def test_being_seen_again_restores_it() -> None:
    confidence = PointConfidence(grid())
    assert confidence.next(grid() + 0.05, SURE, HIDDEN).max() < 0.1
    assert confidence.next(grid() + 0.06, SURE, SEEN).min() > 0.99


def test_neighbours_speak_for_a_point() -> None:
    seen = SEEN.copy()
    seen[27] = False
    found = PointConfidence(grid()).next(grid() + 0.03, SURE, seen)
    assert found[27] > 0.99
    alone = ~seen
    assert PointConfidence(grid()).next(grid() + 0.03, SURE, alone)[27] < 0.5


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_points_work_too(count: int) -> None:
    found = PointConfidence(grid()[:count]).next(grid()[:count], SURE[:count], SEEN[:count])
    assert found.shape == (count,)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 10), st.floats(0, 10), st.booleans()), min_size=1, max_size=8))
def test_stays_in_its_range(steps: list[tuple[float, float, bool]]) -> None:
    confidence = PointConfidence(grid())
    for shift, sigma, seen in steps:
        found = confidence.next(grid() + shift, np.full(64, sigma), np.full(64, seen))
        assert ((found >= 0) & (found <= 1)).all()


def test_two_hands_may_stretch_what_they_hold_in_the_air() -> None:
    heights, depths = np.array([0.0, 0.3, 0.3]), np.array([0.5, 0.5, 0.7])
    np.testing.assert_array_equal(growth_sigma(heights, depths, 1), 0)
    on_table, near, far = growth_sigma(heights, depths, 2)
    assert on_table == 0
    assert 0 < near < far < 0.05
