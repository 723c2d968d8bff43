"""Places that mix reconstructed points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from egophys_core.errors import EpisodeError
from egophys_core.evaluation import identify

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)


def mixture(points: np.ndarray, wanted: list, radius: float = 2.0) -> np.ndarray:
    """Where the only wanted point is at first."""
    return identify(points, np.array([wanted], float), radius).follow(points[None])[0, 0]


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ([0.3, 0.6, 0], [0.3, 0.6, 0]),
        # Above the surface: straight below.
        ([0.3, 0.6, 0.5], [0.3, 0.6, 0]),
        # Outside: the nearest on the border, then the nearest corner.
        ([-0.5, 0.25, 0], [0, 0.25, 0]),
        ([1.5, 1.25, -0.1], [1, 1, 0]),
    ],
)
def test_place_is_the_nearest_on_the_surface(wanted, expected):
    assert mixture(SQUARE, wanted) == pytest.approx(expected, abs=1e-9)


def test_places_follow_a_surface_that_turns_and_stretches():
    wanted = np.array([[0.25, 0.5, 0], [0.75, 0.125, 0]])
    places = identify(SQUARE, wanted, 2.0)
    turn = np.array([[0, -2, 0], [1, 0, 0], [0, 0, 1]], float)
    moved = places.follow(np.stack([SQUARE, SQUARE @ turn.T + [1, 2, 3]]))
    assert moved[0] == pytest.approx(wanted)
    assert moved[1] == pytest.approx(wanted @ turn.T + [1, 2, 3])


def test_point_out_of_radius_or_unknown_is_not_identified():
    wanted = np.array([[0, 0, 0.4], [0, 0, 0.6], [np.nan, 0, 0]])
    places = identify(SQUARE, wanted, 0.5)
    assert places.identified.tolist() == [True, False, False]
    assert np.isnan(places.follow(SQUARE[None])[0]).any(axis=1).tolist() == [False, True, True]


def test_points_without_a_position_are_not_mixed_in():
    points = np.vstack([[[np.nan] * 3], SQUARE])
    assert mixture(points, [0.3, 0.6, 0]) == pytest.approx([0.3, 0.6, 0])
    assert not identify(points[:1], SQUARE, 1.0).identified.any()


def test_place_is_lost_only_with_a_point_that_it_mixes():
    places = identify(SQUARE, np.array([[0.5, 0.0, 0]]), 2.0)
    paths = np.stack([SQUARE, SQUARE, SQUARE])
    paths[1, [2, 3]] = np.nan
    paths[2, 0] = np.nan
    followed = places.follow(paths)[:, 0]
    assert followed[:2] == pytest.approx(np.tile([0.5, 0, 0], (2, 1)))
    assert np.isnan(followed[2]).all()


def test_works_in_the_image_too():
    assert mixture(SQUARE[:, :2], [0.3, 0.6]) == pytest.approx([0.3, 0.6])


def test_place_is_the_nearest_also_where_the_solver_of_scipy_is_wrong(monkeypatch):
    generator = np.random.default_rng(0)
    points, wanted = generator.uniform(0, 1, (40, 3)), generator.uniform(0.2, 0.8, (10, 3))
    right = identify(points, wanted, 0.6).follow(points[None])
    monkeypatch.setattr("egophys_core.evaluation.places.nnls", lambda system, target: (np.eye(system.shape[1])[0], 0.0))
    assert identify(points, wanted, 0.6).follow(points[None]) == pytest.approx(right, abs=1e-6)


def test_bad_input_is_refused():
    with pytest.raises(EpisodeError, match="one D"):
        identify(SQUARE, SQUARE[:, :2], 1.0)
    with pytest.raises(EpisodeError, match="radius"):
        identify(SQUARE, SQUARE, 0.0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.booleans())
def test_weights_are_a_mean_that_is_at_least_as_near_as_the_nearest_point(seed, count, doubled):
    generator = np.random.default_rng(seed)
    points = generator.uniform(-1, 1, (count, 3))
    points = np.repeat(points, 3, axis=0) if doubled else points
    wanted = generator.uniform(-1, 1, (10, 3))
    places = identify(points, wanted, 0.5)
    nearest = np.linalg.norm(points[:, None] - wanted, axis=2).min(axis=0)
    assert (places.identified == (nearest < 0.5)).all()
    assert (places.weights >= 0).all()
    assert places.weights.sum(axis=1) == pytest.approx(places.identified.astype(float))
    left = np.linalg.norm(places.follow(points[None])[0] - wanted, axis=1)[places.identified]
    assert (left <= nearest[places.identified] + 1e-9).all()
    # A point asked for itself is itself.
    assert identify(points, points, 0.5).follow(points[None])[0] == pytest.approx(points, abs=1e-7)
