"""Triangle meshes of masks, hinge gaps and normals against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from egophys_core.errors import EpisodeError
from egophys_core.perception.surface.surface_mesh import (
    boundary_edges,
    hinge_gaps,
    locate,
    mesh_of_mask,
    vertex_normals,
)

SPACING = 6.0


def disc(radius: float = 40.0, size: int = 120) -> np.ndarray:
    y, x = np.mgrid[:size, :size] - size / 2
    return x * x + y * y < radius * radius


def signed_areas(pixels: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (pixels[triangles[:, k]] for k in range(3))
    return ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


def rolled(pixels: np.ndarray, radius: float) -> np.ndarray:
    """Places in the plane rolled around a cylinder along y, keeping lengths in the surface."""
    angle = pixels[:, 0] / radius
    return np.column_stack([radius * np.sin(angle), pixels[:, 1], radius * (1 - np.cos(angle))])


class TestMesh:
    def test_covers_the_mask_once(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        areas = signed_areas(mesh.pixels, mesh.triangles)
        assert (areas > 0).all()
        assert areas.sum() == pytest.approx(disc().sum(), rel=0.06)

    def test_vertices_are_about_a_spacing_apart(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        length = np.linalg.norm(np.diff(mesh.pixels[mesh.edges], axis=1)[:, 0], axis=1)
        assert np.median(length) == pytest.approx(SPACING, rel=0.25)
        assert length.max() < 2.5 * SPACING
        assert length.min() > 0.3 * SPACING

    def test_all_vertices_are_used_and_edges_are_unique(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        np.testing.assert_array_equal(np.unique(mesh.triangles), np.arange(len(mesh.pixels)))
        assert len(np.unique(np.sort(mesh.edges, axis=1), axis=0)) == len(mesh.edges)
        # Euler's formula for a disc, the outside not counted.
        assert len(mesh.pixels) - len(mesh.edges) + len(mesh.triangles) == 1

    def test_inner_edges_have_a_hinge_and_outer_ones_none(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        outer = boundary_edges(mesh.triangles)
        assert len(mesh.hinges) + len(outer) == len(mesh.edges)
        inner = {tuple(sorted(pair)) for pair in mesh.hinges[:, :2].tolist()}
        assert not inner & {tuple(pair) for pair in outer.tolist()}
        triangles = {frozenset(each) for each in mesh.triangles.tolist()}
        for a, b, c, d in mesh.hinges.tolist():
            assert {frozenset((a, b, c)), frozenset((a, b, d))} <= triangles

    def test_a_bay_is_not_bridged(self) -> None:
        mask = np.zeros((100, 100), bool)
        mask[10:90, 10:90] = True
        mask[10:60, 40:60] = False
        mesh = mesh_of_mask(mask, SPACING)
        triangle, _ = locate(mesh, np.array([[50.0, 20.0], [50.0, 50.0], [20.0, 20.0]]))
        assert (triangle[:2] == -1).all()
        assert triangle[2] >= 0

    def test_reaches_a_mask_at_the_image_border(self) -> None:
        mask = np.zeros((60, 60), bool)
        mask[30:, 30:] = True
        mesh = mesh_of_mask(mask, SPACING)
        assert mesh.pixels.min() >= 30 - 1e-9
        assert mesh.pixels.max() <= 59 + 1e-9

    @pytest.mark.parametrize("pixels", [0, 1, 2, 5])
    def test_a_few_pixels_are_an_error_that_says_how_many(self, pixels: int) -> None:
        mask = np.zeros((50, 50), bool)
        mask[20, 20 : 20 + pixels] = True
        with pytest.raises(EpisodeError, match=f"covers {pixels} pixels"):
            mesh_of_mask(mask, SPACING)

    @settings(max_examples=60, deadline=None)
    @given(npst.arrays(bool, (24, 30), elements=st.booleans()), st.floats(3.0, 12.0))
    def test_any_mask_gives_a_sound_mesh_or_an_error(self, mask: np.ndarray, spacing: float) -> None:
        try:
            mesh = mesh_of_mask(mask, spacing)
        except EpisodeError:
            return
        assert np.isfinite(mesh.pixels).all()
        assert len(mesh.triangles) > 0
        assert (signed_areas(mesh.pixels, mesh.triangles) > 0).all()

    def test_a_line_of_pixels_is_an_error(self) -> None:
        mask = np.zeros((80, 200), bool)
        mask[40, 10:190] = True
        with pytest.raises(EpisodeError):
            mesh_of_mask(mask, SPACING)


class TestLocate:
    def test_weights_give_the_place_back_and_sum_to_one(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        places = np.random.default_rng(0).uniform(35, 85, (200, 2))
        triangle, weights = locate(mesh, places)
        assert (triangle >= 0).all()
        np.testing.assert_allclose(weights.sum(axis=1), 1)
        assert weights.min() >= -1e-8
        back = np.einsum("nk,nkd->nd", weights, mesh.pixels[mesh.triangles[triangle]])
        np.testing.assert_allclose(back, places, atol=1e-9)

    def test_vertices_are_inside(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        triangle, weights = locate(mesh, mesh.pixels)
        assert (triangle >= 0).all()
        np.testing.assert_allclose(weights.max(axis=1), 1, atol=1e-9)

    def test_outside_and_nan_are_nowhere(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        triangle, weights = locate(mesh, np.array([[0.0, 0.0], [np.nan, 50.0], [1e9, 50.0]]))
        assert (triangle == -1).all()
        assert not weights.any()


class TestHingeGaps:
    def test_vanish_on_linear_functions(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        gaps = hinge_gaps(mesh.hinges, mesh.pixels)
        linear = np.column_stack([np.ones(len(mesh.pixels)), mesh.pixels, mesh.pixels @ [0.3, -2.0]])
        np.testing.assert_allclose(gaps @ linear, 0, atol=1e-9)

    def test_have_a_height_on_a_quadratic(self) -> None:
        # Corners of a unit square: the diagonals of z = x y pass each other by 1/2.
        places = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
        gap = hinge_gaps(np.array([[0, 1, 2, 3]]), places) @ (places[:, 0] * places[:, 1])
        assert abs(gap[0]) == pytest.approx(0.5)

    def test_do_not_depend_on_an_isometric_bend_of_what_they_are_made_from(self) -> None:
        # Laid flat, a pair of triangles of a gently rolled sheet is the pair of the flat sheet.
        mesh = mesh_of_mask(disc(), SPACING)
        flat = hinge_gaps(mesh.hinges, mesh.pixels)
        bent = hinge_gaps(mesh.hinges, rolled(mesh.pixels - 60, 300.0))
        assert abs(flat - bent).max() < 1e-3

    def test_turned_and_moved_shapes_give_the_same(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        shape = rolled(mesh.pixels - 60, 60.0)
        turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
        same = hinge_gaps(mesh.hinges, shape @ turn.T + [1, 2, 3])
        np.testing.assert_allclose(same.toarray(), hinge_gaps(mesh.hinges, shape).toarray(), atol=1e-9)

    def test_collapsed_triangles_stay_finite(self) -> None:
        gaps = hinge_gaps(np.array([[0, 1, 2, 3]]), np.zeros((4, 3)))
        assert np.isfinite(gaps.toarray()).all()


class TestNormals:
    def test_of_a_sphere_are_its_radii(self) -> None:
        mesh = mesh_of_mask(disc(), 3.0)
        flat = (mesh.pixels - 60) / 60
        ball = np.column_stack([flat, np.sqrt(1 - (flat**2).sum(axis=1))])
        normals = vertex_normals(mesh.triangles, ball)
        inner = np.setdiff1d(np.arange(len(ball)), boundary_edges(mesh.triangles))
        assert (normals * ball).sum(axis=1)[inner].min() > np.cos(np.radians(2))

    def test_a_plane_has_one_normal_and_nothing_has_none(self) -> None:
        mesh = mesh_of_mask(disc(), SPACING)
        plane = np.column_stack([mesh.pixels, 0.5 * mesh.pixels[:, 0]])
        expected = np.array([-0.5, 0, 1]) / np.sqrt(1.25)
        np.testing.assert_allclose(vertex_normals(mesh.triangles, plane), expected + 0 * plane, atol=1e-9)
        assert not vertex_normals(mesh.triangles, 0 * plane).any()


def test_boundary_of_one_triangle_is_all_of_it() -> None:
    assert len(boundary_edges(np.array([[0, 1, 2]]))) == 3
    assert len(boundary_edges(np.array([[0, 1, 2], [2, 1, 3]]))) == 4
