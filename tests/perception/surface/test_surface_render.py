"""Which triangle a pixel shows, and the texture laid over it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.perception.surface.surface_mesh import SurfaceMesh, mesh_of_mask
from egophys_core.perception.surface.surface_render import barycentric, facing, project, render, textured

K = np.array([[300.0, 0, 59.5], [0, 320.0, 49.5], [0, 0, 1]])
SIZE = (100, 120)


def square_mesh() -> SurfaceMesh:
    mask = np.zeros(SIZE, bool)
    mask[20:80, 30:90] = True
    return mesh_of_mask(mask, 6.0)


def corners_of(mesh: SurfaceMesh, pixels: np.ndarray, depth: float | np.ndarray = 1.0) -> np.ndarray:
    depths = np.broadcast_to(depth, len(pixels))
    return np.column_stack([pixels, depths])[mesh.triangles]


class TestProject:
    def test_hand_worked(self) -> None:
        pose = np.eye(4)
        pose[:3, 3] = [0, 0, -2]
        np.testing.assert_allclose(project(np.array([[0.1, 0.2, 0.0]]), K, pose), [[74.5, 81.5, 2.0]])

    def test_moving_scene_and_camera_together_changes_nothing(self) -> None:
        random = np.random.default_rng(0)
        points = random.normal(size=(20, 3)) * 0.1 + [0, 0, 1]
        move = np.eye(4)
        move[:3, :3], move[:3, 3] = Rotation.from_rotvec([0.4, -1.0, 0.2]).as_matrix(), [1, 2, 3]
        moved = points @ move[:3, :3].T + move[:3, 3]
        np.testing.assert_allclose(project(moved, K, move), project(points, K, np.eye(4)), atol=1e-9)

    def test_behind_and_on_the_camera_stay_finite(self) -> None:
        found = project(np.array([[0.0, 0, -1], [0.1, 0, 0]]), K, np.eye(4))
        assert np.isfinite(found).all()
        assert (found[:, 2] <= 0).all()


class TestBarycentric:
    def test_sum_to_one_and_give_the_place_back(self) -> None:
        random = np.random.default_rng(1)
        corners, points = random.uniform(0, 50, (30, 3, 2)), random.uniform(-20, 80, (30, 2))
        weights = barycentric(corners, points)
        np.testing.assert_allclose(weights.sum(axis=1), 1)
        np.testing.assert_allclose(np.einsum("nk,nkd->nd", weights, corners), points, atol=1e-6)

    def test_a_triangle_without_area_gives_thirds(self) -> None:
        corners = np.array([[[0.0, 0], [1, 1], [2, 2]]])
        np.testing.assert_allclose(barycentric(corners, np.array([[5.0, 3]])), 1 / 3)


class TestRender:
    def test_reference_view_shows_each_pixel_its_own_place(self) -> None:
        mesh = square_mesh()
        drawn = render(corners_of(mesh, mesh.pixels), SIZE)
        y, x = np.nonzero(drawn.silhouette)
        assert drawn.silhouette[22:78, 32:88].all()
        assert drawn.silhouette.sum() == pytest.approx(3600, rel=0.06)
        inner = (y > 21) & (y < 78) & (x > 31) & (x < 88)
        source = drawn.source(mesh.pixels[mesh.triangles])
        np.testing.assert_allclose(source[y, x][inner], np.column_stack([x, y])[inner], atol=0.05)
        assert np.isnan(source[~drawn.silhouette]).all()

    def test_triangles_that_a_picture_does_not_show_have_no_source(self) -> None:
        mesh = square_mesh()
        drawn = render(corners_of(mesh, mesh.pixels), SIZE)
        places = mesh.pixels[mesh.triangles]
        places[::2] = np.nan
        known = np.isfinite(drawn.source(places)[drawn.silhouette]).all(axis=1)
        np.testing.assert_array_equal(known, drawn.triangle[drawn.silhouette] % 2 == 1)

    def test_shifted_surface_shows_the_shifted_texture(self) -> None:
        mesh = square_mesh()
        random = np.random.default_rng(2)
        reference = random.integers(0, 255, SIZE).astype(np.uint8)
        source = render(corners_of(mesh, mesh.pixels + [7, -5]), SIZE).source(mesh.pixels[mesh.triangles])
        drawn = textured(source, reference, np.zeros(SIZE, np.uint8))
        difference = np.abs(drawn[20:70, 42:92].astype(int) - reference[25:75, 35:85])
        assert np.median(difference) <= 3
        assert drawn[90, 10] == 0

    def test_the_nearer_triangle_is_seen(self) -> None:
        mesh = square_mesh()
        left = mesh.pixels[mesh.triangles].mean(axis=1)[:, 0] < 60
        corners = corners_of(mesh, mesh.pixels)
        # The left half is folded over the right one, once in front and once behind.
        corners[left, :, 0] = 120 - corners[left, :, 0]
        for depth, expected in ((0.9, True), (1.1, False)):
            corners[left, :, 2] = depth
            shown = render(corners, SIZE).triangle[30:70, 70:85]
            assert (left[shown] == expected).mean() > 0.99

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e12])
    def test_places_that_are_nowhere_are_left_out(self, bad: float) -> None:
        mesh = square_mesh()
        corners = corners_of(mesh, mesh.pixels)
        corners[::2, 1, 0] = bad
        shown = np.unique(render(corners, SIZE).triangle)
        assert not np.isin(shown[shown >= 0], np.arange(0, len(corners), 2)).any()

    def test_behind_the_camera_nothing_is_drawn(self) -> None:
        mesh = square_mesh()
        drawn = render(corners_of(mesh, mesh.pixels, -1.0), SIZE)
        assert not drawn.silhouette.any()
        background = np.full(SIZE, 9, np.uint8)
        source = drawn.source(mesh.pixels[mesh.triangles])
        np.testing.assert_array_equal(textured(source, background + 1, background), background)

    def test_outside_the_image_nothing_is_drawn(self) -> None:
        mesh = square_mesh()
        assert not render(corners_of(mesh, mesh.pixels + 500), SIZE).silhouette.any()


def test_the_reference_side_faces_and_a_mirrored_one_does_not() -> None:
    mesh = square_mesh()
    assert facing(corners_of(mesh, mesh.pixels)).all()
    assert not facing(corners_of(mesh, mesh.pixels * [-1, 1])).any()
