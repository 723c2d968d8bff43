"""A hand that would be farther from a sheet than the sheet reaches has a wrong width; others keep theirs."""

import numpy as np
import pytest

from egophys_core.perception.hands.reach import path_within_reach

EYE = np.array([0.0, -0.5, 0.5])
VIEWS = 40


@pytest.fixture
def held() -> tuple[np.ndarray, np.ndarray]:
    """A hand [T, 3] that lifts a sheet [T, N, 3] by its middle, all of it alike."""
    flat = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.1, 0.1, 9), [0.0]), axis=-1).reshape(-1, 3)
    rise = np.column_stack([np.zeros((VIEWS, 2)), np.linspace(0.0, 0.15, VIEWS)])
    return rise, flat + rise[:, None]


def with_wrong_depth(hand: np.ndarray, views: slice) -> np.ndarray:
    wrong = hand.copy()
    wrong[views] = EYE + 0.7 * (hand[views] - EYE)
    return wrong


def test_a_depth_that_the_sheet_does_not_reach_is_put_right(held) -> None:
    hand, sheet = held
    wrong = with_wrong_depth(hand, slice(20, 30))
    found = path_within_reach(wrong, np.tile(EYE, (VIEWS, 1)), 3, sheet, np.ones(sheet.shape[:2], bool))
    assert np.linalg.norm(wrong - hand, axis=1).max() > 0.15
    assert np.linalg.norm(found - hand, axis=1).max() < 0.01
    np.testing.assert_allclose(np.delete(found, slice(20, 30), axis=0), np.delete(hand, slice(20, 30), axis=0))


def test_a_depth_that_stays_wrong_stays_as_it_was_before(held) -> None:
    hand, sheet = held
    wrong = with_wrong_depth(hand, slice(20, None))
    found = path_within_reach(wrong, np.tile(EYE, (VIEWS, 1)), 3, sheet, np.ones(sheet.shape[:2], bool))
    assert np.linalg.norm(found[20:] - EYE, axis=1) == pytest.approx(np.linalg.norm(hand[19] - EYE), rel=1e-6)


def test_cloth_that_gives_or_is_not_seen_says_nothing(held) -> None:
    hand, sheet = held
    eyes = np.tile(EYE, (VIEWS, 1))
    stretched = sheet.copy()
    stretched[3:] = hand[3:, None] + 1.15 * (sheet[3:] - hand[3:, None])
    np.testing.assert_allclose(path_within_reach(hand, eyes, 3, stretched, np.ones(sheet.shape[:2], bool)), hand)
    wrong = with_wrong_depth(hand, slice(20, 30))
    np.testing.assert_allclose(path_within_reach(wrong, eyes, 3, sheet, np.zeros(sheet.shape[:2], bool)), wrong)
