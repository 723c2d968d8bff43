"""Scale and frame of a reconstruction of unknown scale, from a scene whose every depth is known."""

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.anchoring import motion_scale, rays, table_scale, world_on_largest_plane
from tests.perception.learned.scene import CAMERA, SIZE, pose_at, true_depth, true_points, view_at

SCALE = 0.23


def found_scale(depths, *, views=None, believed=None, table_area=None, table_height=0.0):
    views = views or [view_at(index) for index in range(len(depths))]
    believed = np.ones(depths.shape, bool) if believed is None else believed
    return table_scale(views, depths, believed, table_height=table_height, table_area=table_area)


def test_the_table_tells_the_scale_although_something_stands_on_it():
    depths = np.stack([true_depth(pose_at(index)) for index in range(2)]) / SCALE
    noisy = depths * np.random.default_rng(0).normal(1, 0.005, depths.shape)
    assert found_scale(depths) == pytest.approx(SCALE, rel=1e-6)
    assert found_scale(noisy) == pytest.approx(SCALE, rel=2e-3)


def test_a_table_of_another_height_is_another_scale():
    depths = true_depth(pose_at(0))[None] / SCALE
    assert found_scale(depths, table_height=-0.1) > 1.1 * SCALE


def test_only_the_area_of_the_board_is_looked_at_if_it_is_known():
    # Two thirds of the image show a plate 50 mm high; only the board's area shows the table.
    pose = pose_at(0)
    depth, points = true_depth(pose), true_points(pose)
    shelf = points[..., 1] < 0.08
    lifted = np.where(shelf, depth * (pose[2, 3] - 0.05) / pose[2, 3], depth) / SCALE
    assert found_scale(lifted[None]) == pytest.approx(SCALE * pose[2, 3] / (pose[2, 3] - 0.05), rel=0.02)
    assert found_scale(lifted[None], table_area=(-1, 1, 0.1, 1)) == pytest.approx(SCALE, rel=1e-3)


def test_no_scale_without_a_pose_or_without_pixels_that_agree():
    depths = true_depth(pose_at(0))[None] / SCALE
    assert found_scale(depths, views=[view_at(0, has_pose=False)]) is None
    assert found_scale(depths, believed=np.zeros(depths.shape, bool)) is None
    wild = depths * np.random.default_rng(0).uniform(0.2, 5, depths.shape)
    assert found_scale(wild) is None


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_depths_that_are_none_are_passed_over(bad):
    depths = true_depth(pose_at(0))[None] / SCALE
    depths[:, ::3] = bad
    assert found_scale(depths) == pytest.approx(SCALE, rel=1e-6)


def test_motion_tells_the_scale_only_if_there_is_enough_of_it():
    rotation = pose_at(3)[:3, :3]
    there = np.random.default_rng(0).normal(size=(6, 3))
    here = SCALE * there @ rotation.T + [1.0, 2.0, 3.0]
    noise = np.random.default_rng(1).normal(0, 0.001, here.shape)
    assert motion_scale(here + noise, there, rotation, distance=5.0) == pytest.approx(SCALE, rel=0.01)
    assert motion_scale(here, 1e-3 * there, rotation, distance=5.0) is None
    assert motion_scale(here[:1], there[:1], rotation, distance=5.0) is None
    assert motion_scale(-here, there, rotation, distance=5.0) is None


def test_without_any_pose_the_table_is_the_largest_plane():
    pose = pose_at(2)
    in_camera = rays(CAMERA, (SIZE, SIZE)) * true_depth(pose)[..., None]
    found = world_on_largest_plane(in_camera.reshape(-1, 3))
    heights = (in_camera @ found[:3, :3].T + found[:3, 3])[..., 2]
    np.testing.assert_allclose(heights, true_points(pose)[..., 2], atol=1e-6)
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)
    assert found[2, 3] == pytest.approx(pose[2, 3], abs=1e-6)


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.outer(np.arange(9.0), [1, 2, 3]), np.ones((9, 3))])
def test_no_plane_is_said_so(points):
    with pytest.raises(EpisodeError, match=r"table|plane"):
        world_on_largest_plane(points)
