"""Geometry of several rooms: points spread evenly, nearest rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.geometry import about_vertical, farthest_first, farthest_points, nearest_rotation, turn_about_vertical


def test_farthest_points_of_a_square_are_its_corners():
    x, y = np.meshgrid(np.arange(5), np.arange(5))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(25)])
    assert points[farthest_points(points, 4), :2].tolist() == [[0, 0], [4, 0], [0, 4], [4, 4]]


def test_farthest_points_repeat_and_are_increasing_and_never_unknown():
    points = np.random.default_rng(1).normal(size=(200, 3))
    points[::7] = np.nan
    chosen = farthest_points(points, 30)
    assert len(chosen) == 30
    assert (np.diff(chosen) > 0).all()
    assert np.isfinite(points[chosen]).all()
    assert (chosen == farthest_points(points.copy(), 30)).all()


@pytest.mark.parametrize("count", [0, 1, 3, 10])
def test_farthest_points_of_few_or_equal_points(count):
    assert len(farthest_points(np.zeros((5, 3)), count)) == min(5, count)
    assert len(farthest_points(np.zeros((0, 3)), count)) == 0


def test_each_is_the_farthest_from_those_before_it():
    places = np.array([[0.0], [1.0], [4.0], [10.0]]) * [1.0, 0.0, 0.0]
    assert farthest_first(places, 4, first=1).tolist() == [1, 3, 2, 0]


def test_a_rotation_is_the_nearest_to_itself_and_to_itself_stretched():
    rotations = Rotation.random(20, random_state=0).as_matrix()
    np.testing.assert_allclose(nearest_rotation(rotations), rotations, atol=1e-12)
    np.testing.assert_allclose(nearest_rotation(rotations @ np.diag([3.0, 1.0, 0.2])), rotations, atol=1e-12)


def test_no_rotation_is_nearer_to_a_matrix():
    matrices = np.random.default_rng(0).normal(size=(10, 3, 3))
    found = nearest_rotation(matrices)
    np.testing.assert_allclose(np.linalg.det(found), 1.0)
    turns = Rotation.random(200, random_state=1).as_matrix()
    others = np.linalg.norm(turns - matrices[:, None], axis=(2, 3)).min(axis=1)
    assert (np.linalg.norm(found - matrices, axis=(1, 2)) <= others).all()


def test_vectors_turn_about_the_vertical_and_by_nothing_not_at_all():
    vectors = np.random.default_rng(0).normal(size=(7, 3))
    turned = about_vertical(vectors, np.array([[0.4], [-2.0]]))
    assert turned.shape == (2, 7, 3)
    for row, angle in enumerate((0.4, -2.0)):
        np.testing.assert_allclose(turned[row], Rotation.from_rotvec([0.0, 0.0, angle]).apply(vectors), atol=1e-12)
    np.testing.assert_array_equal(about_vertical(vectors, np.zeros(7)), vectors)


@pytest.mark.parametrize("angle", [0.0, 0.7, -2.5])
def test_a_turn_about_the_vertical_is_told_from_points_that_were_moved_too(angle):
    points = np.random.default_rng(1).normal(size=(6, 3))
    assert turn_about_vertical(points, about_vertical(points, np.full(6, angle)) + [0.3, -0.2, 0.1]) == pytest.approx(
        angle
    )
    assert turn_about_vertical(points[:1], points[1:2]) == 0.0
