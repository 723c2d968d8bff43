"""Hands that push or draw go along the table, whatever their width says; those that leave it do."""

import numpy as np
import pytest

from egophys_core.perception.hands.level_paths import PUSHING_DRIFT, above_table, drawn_path, level_path

EYE = np.array([0.0, -0.5, 0.5])


def pushed(heights: np.ndarray) -> np.ndarray:
    """[T, 3] metres: a hand that goes 0.2 m to the left."""
    return np.column_stack([np.linspace(0.1, -0.1, len(heights)), np.full(len(heights), 0.02), heights])


def by_width(path: np.ndarray, error: np.ndarray | float) -> np.ndarray:
    """The same as its width tells it, wrong by a share of its distance."""
    return EYE + (1 + np.broadcast_to(error, len(path)))[:, None] * (path - EYE)


def off(found: np.ndarray, path: np.ndarray) -> np.ndarray:
    return np.linalg.norm(found - path, axis=1)


def test_a_width_that_drifts_is_put_right_by_the_height() -> None:
    path = pushed(np.full(40, 0.04))
    wrong = by_width(path, np.linspace(0.0, -0.06, 40))
    found = level_path(wrong, np.tile(EYE, (40, 1)), 0.04, PUSHING_DRIFT)
    assert off(wrong, path).max() > 0.035
    assert off(found, path).max() < 0.012


def test_the_place_in_the_view_stays() -> None:
    wrong = by_width(pushed(np.full(40, 0.04)), -0.05)
    found = level_path(wrong, np.tile(EYE, (40, 1)), 0.04, PUSHING_DRIFT)
    before, after = wrong - EYE, found - EYE
    along = (before * after).sum(axis=1) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
    assert along == pytest.approx(np.ones(40), abs=1e-9)


def test_a_hand_that_is_lifted_leaves_the_table() -> None:
    path = pushed(np.concatenate([np.full(20, 0.04), np.linspace(0.04, 0.3, 30)]))
    found = level_path(by_width(path, 0.01), np.tile(EYE, (50, 1)), 0.04, PUSHING_DRIFT)
    assert off(found, path)[35:].max() < 0.025
    assert found[-1, 2] > 0.27


def test_a_hand_that_draws_a_sheet_is_level_and_one_that_lifts_it_is_not() -> None:
    path = pushed(np.full(40, 0.008))
    wrong = by_width(path, np.linspace(0.0, -0.03, 40))
    eyes = np.tile(EYE, (40, 1))
    offsets = np.random.default_rng(0).uniform([-0.1, -0.1, -0.003], [0.1, 0.1, 0.003], (60, 3))
    sheet = path[:, None] + offsets
    sure = np.ones(sheet.shape[:2], bool)
    drawn = drawn_path(wrong, eyes, 5, sheet, sure, 0.0)
    assert off(drawn, path)[10:].max() < 0.5 * off(wrong, path)[10:].max()
    lifted = drawn_path(wrong, eyes, 5, sheet + [0, 0, 0.1], sure, 0.0)
    np.testing.assert_array_equal(lifted, wrong)
    unseen = drawn_path(wrong, eyes, 5, sheet, ~sure, 0.0)
    np.testing.assert_array_equal(unseen, wrong)


def test_no_hand_is_under_the_table() -> None:
    path = pushed(np.linspace(-0.03, 0.03, 40))
    found = above_table(path, np.tile(EYE, (40, 1)), -0.01)
    under = path[:, 2] < -0.01
    assert found[under, 2] == pytest.approx(-0.01)
    np.testing.assert_allclose(np.cross(found - EYE, path - EYE), 0, atol=1e-12)
    np.testing.assert_allclose(found[~under], path[~under])
