"""Paths of hands put right by what they hold."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.perception.hands.carried_paths import carried_path, unturned

FRAMES, FIRST = 40, 8
TIMES = np.arange(FRAMES) / 30
GRIP = np.array([0.05, 0.0, 0.1])
BODY = np.random.default_rng(0).uniform(-0.06, 0.06, (300, 3)) + GRIP


def moved() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [T, N, 3], true places [T, 3] and turns [T, 3, 3] of a hand that lifts and turns a body."""
    share = np.clip((np.arange(FRAMES) - FIRST) / 25, 0, 1)
    turns = Rotation.from_rotvec(share[:, None] * [0.0, 0.3, 0.6]).as_matrix()
    places = GRIP + share[:, None] * [0.1, -0.05, 0.15]
    return places[:, None] + np.einsum("tij,nj->tni", turns, BODY - GRIP), places, turns


def drifting(places: np.ndarray) -> np.ndarray:
    """The places by an outline, whose depth drifts by 4 cm once it holds."""
    return places + np.clip((np.arange(FRAMES) - FIRST) / 20, 0, 1)[:, None] * [0.0, 0.04, 0.0]


@pytest.mark.parametrize("hidden", [(), range(20, 26)])
def test_a_hand_goes_where_what_it_holds_goes(hidden: range | tuple[int, ...]) -> None:
    points, places, turns = moved()
    seen = np.ones(points.shape[:2], bool)
    seen[list(hidden)] = False
    found = carried_path(drifting(places), FIRST, points, seen, TIMES)
    assert np.linalg.norm(found.places - places, axis=1).max() < 0.006
    angle = Rotation.from_matrix(np.einsum("tji,tjk->tik", turns, found.turns)).magnitude()
    assert angle.max() < 0.05
    np.testing.assert_allclose(found.turns[0], np.eye(3), atol=1e-9)


def test_what_moves_otherwise_does_not_count() -> None:
    points, places, _ = moved()
    seen = np.ones(points.shape[:2], bool)
    # The outline says that the hand goes elsewhere: it has let go.
    left = places + np.linspace(0, 1, FRAMES)[:, None] * [-2.0, 0, 0]
    away = carried_path(left, FIRST, points, seen, TIMES)
    assert np.linalg.norm(away.places[-1] - left[-1]) < 0.09
    # Points that shake by a centimetre each are no piece.
    shaken = points + 0.01 * np.random.default_rng(1).standard_normal(points.shape)
    kept = carried_path(drifting(places), FIRST, shaken, seen, TIMES)
    np.testing.assert_array_equal(kept.places, drifting(places))


def test_without_points_the_path_stays() -> None:
    points, places, _ = moved()
    found = carried_path(places, FIRST, points, np.zeros(points.shape[:2], bool), TIMES)
    np.testing.assert_array_equal(found.places, places)
    np.testing.assert_array_equal(found.turns, unturned(places).turns)
