"""Similarities against ones written down."""

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.similarity import Similarity, fit_similarity, mean_rotation


def turn(axis: tuple[float, float, float], degrees: float) -> np.ndarray:
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


TRUE = Similarity(scale=0.37, rotation=turn((1, 2, 3), 130), translation=np.array([0.4, -2.0, 1.0]))


def test_a_similarity_comes_back_from_its_pairs():
    source = np.random.default_rng(0).normal(size=(20, 3))
    found = fit_similarity(source, TRUE.apply(source))
    assert found.scale == pytest.approx(TRUE.scale, rel=1e-12)
    np.testing.assert_allclose(found.rotation, TRUE.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, TRUE.translation, atol=1e-12)


def test_apply_inverse_undoes_apply():
    points = np.random.default_rng(1).normal(size=(4, 5, 3))
    np.testing.assert_allclose(TRUE.apply_inverse(TRUE.apply(points)), points, atol=1e-12)


def test_points_of_a_plane_and_mirrored_ones_give_a_rotation_and_no_mirror():
    flat = np.random.default_rng(2).normal(size=(10, 3)) * [1, 1, 0]
    mirrored = np.random.default_rng(3).normal(size=(10, 3))
    for source, target in ((flat, TRUE.apply(flat)), (mirrored, mirrored * [1, 1, -1])):
        assert np.linalg.det(fit_similarity(source, target).rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(fit_similarity(flat, TRUE.apply(flat)).rotation, TRUE.rotation, atol=1e-9)


@pytest.mark.parametrize("source", [np.zeros((2, 3)), np.ones((5, 3))])
def test_too_little_to_fit_is_refused(source):
    with pytest.raises(EpisodeError, match="a similarity needs"):
        fit_similarity(source, source)


def test_mean_rotation_of_opposite_errors_is_the_middle_one():
    middle = turn((0, 1, 1), 40)
    off = np.stack([middle @ turn((1, 0, 0), 5), middle @ turn((1, 0, 0), -5)])
    np.testing.assert_allclose(mean_rotation(off), middle, atol=1e-12)
