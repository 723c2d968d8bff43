"""Points of a hand in space."""

import numpy as np
import pytest

from egophys_core.perception.hands.hand_points import at_depth, ball
from egophys_core.perception.surface.surface_render import project
from tests.perception.surface.surface_scene import video


@pytest.mark.parametrize("count", [2, 5, 15, 60])
def test_ball_is_as_wide_as_closed_fingers_and_about_the_origin(count: int) -> None:
    points = ball(count)
    assert points.shape == (count, 3)
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=1e-9)
    reach = np.linalg.norm(points, axis=1)
    assert 0.01 < reach.max() < 0.035
    np.testing.assert_array_equal(points, ball(count))


def test_ball_is_filled_evenly() -> None:
    points = ball(200)
    # In an even ball the second moments are a fifth of the squared radius along every axis.
    deviation = points.std(axis=0)
    assert deviation == pytest.approx(np.full(3, np.linalg.norm(points, axis=1).max() / np.sqrt(5)), rel=0.08)


def test_one_point_is_the_middle() -> None:
    np.testing.assert_allclose(ball(1), np.zeros((1, 3)), atol=1e-12)


def test_pixels_at_a_depth_project_back() -> None:
    view, pixels = video()[0].view, np.array([[10.0, 20], [160, 300]])
    found = project(at_depth(pixels, 0.4, view), view.camera_matrix, view.world_from_camera)
    np.testing.assert_allclose(found, np.column_stack([pixels, [0.4, 0.4]]))
