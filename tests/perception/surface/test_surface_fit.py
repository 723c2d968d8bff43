"""Shape from template: derivatives, invariances, and a sheet bent by a known isometry."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.perception.camera.parallax import rays_of_pixels
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_fit import Correspondences, SurfaceFitter, SurfaceModel, fitter_of
from egophys_core.perception.surface.surface_mesh import SurfaceMesh, mesh_of_mask, vertex_normals
from egophys_core.perception.surface.surface_render import project

K = np.array([[400.0, 0, 99.5], [0, 400.0, 99.5], [0, 0, 1]])
LOOSE = 0.5
"""Metres: deviation of a prediction that says nothing."""


def camera() -> View:
    """Looks down on the table, slanted."""
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1, -1]) @ Rotation.from_rotvec([0.45, 0, 0]).as_matrix()
    pose[:3, 3] = [0.0, -0.22, 0.45]
    return View(stamp_ns=0, image=np.zeros((200, 200, 3), np.uint8), camera_matrix=K, world_from_camera=pose)


def mesh_and_rest(spacing: float = 8.0, height: float = 0.0) -> tuple[SurfaceMesh, np.ndarray]:
    """A sheet of 140 x 90 mm or so that lies level in the camera's view."""
    mask = np.zeros((200, 200), bool)
    mask[70:140, 40:160] = True
    mesh = mesh_of_mask(mask, spacing)
    view = camera()
    rays, centre = rays_of_pixels(mesh.pixels, view), view.world_from_camera[:3, 3]
    return mesh, centre + rays * ((height - centre[2]) / rays[:, 2])[:, None]


def model(*, thickness: float = 0.0, spacing: float = 8.0, lowest: float = 0.0, height: float = 0.0) -> SurfaceModel:
    mesh, rest = mesh_and_rest(spacing, height)
    return SurfaceModel(
        mesh=mesh,
        rest=rest,
        triangles=mesh.triangles,
        thickness=thickness,
        stretch_sigma=0.01,
        shortening_sigma=0.02,
        bending_sigma=0.0015,
        lowest=lowest,
    )


def rolled(rest: np.ndarray, radius: float, sideways: float = 0.0) -> np.ndarray:
    """A level sheet rolled up from its left end around a cylinder; an isometry."""
    from_left = rest[:, 0] - rest[:, 0].min()
    angle = from_left / radius
    x = rest[:, 0].min() + radius * np.sin(angle)
    return np.column_stack([x, rest[:, 1] + sideways, rest[:, 2] + radius * (1 - np.cos(angle))])


def sightings_of(fitter: SurfaceFitter, positions: np.ndarray, view: View, noise: float = 0.0) -> Correspondences:
    """Three places of each triangle, seen exactly or with noise, on the skin towards the camera."""
    mesh = fitter.model.mesh
    corners = np.repeat(mesh.triangles, 3, axis=0)
    weights = np.tile(np.array([[0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6]]), (len(mesh.triangles), 1))
    skin = fitter.skin(positions, 1.0)
    places = np.einsum("mk,mkd->md", weights, skin[corners])
    pixels = project(places, view.camera_matrix, view.world_from_camera)[:, :2]
    count = len(corners)
    return Correspondences(
        corners=corners,
        weights=weights,
        side=np.ones(count),
        pixels=pixels + np.random.default_rng(0).normal(0, noise, pixels.shape),
        sigma=np.full(count, 0.3),
        robust_scale=np.full(count, 2.0),
    )


def wobbled(positions: np.ndarray, size: float = 0.003) -> np.ndarray:
    return positions + np.random.default_rng(5).normal(0, size, positions.shape)


def none_seen() -> Correspondences:
    return Correspondences(
        corners=np.zeros((0, 3), int),
        weights=np.zeros((0, 3)),
        side=np.zeros(0),
        pixels=np.zeros((0, 2)),
        sigma=np.zeros(0),
        robust_scale=np.zeros(0),
    )


def numeric(
    function: Callable[[np.ndarray], np.ndarray], positions: np.ndarray, chosen: np.ndarray, step: float = 1e-6
) -> np.ndarray:
    """[R, K] central differences of function(positions) [R] by the chosen coordinates."""
    columns = []
    for index in chosen:
        ends = []
        for sign in (1, -1):
            moved = positions.copy()
            moved.ravel()[index] += sign * step
            ends.append(function(moved))
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.column_stack(columns)


class TestDerivatives:
    chosen = np.random.default_rng(2).choice(3 * 60, 12, replace=False)

    @pytest.mark.parametrize("thickness", [0.0, 0.004])
    def test_of_reprojection(self, thickness: float) -> None:
        fitter, view = fitter_of(model(thickness=thickness)), camera()
        positions = wobbled(fitter.model.rest)
        seen = sightings_of(fitter, fitter.model.rest, view)
        _, jacobian = fitter._reprojection(view, seen, positions)
        expected = numeric(lambda x: fitter._reprojection(view, seen, x)[0].ravel(), positions, self.chosen)
        # Normals are held: what they turn is a hundredth of a pixel's way for skins of 2 mm.
        tolerance = 1e-4 if thickness == 0 else 0.6 * np.abs(expected).max()
        np.testing.assert_allclose(jacobian[:, self.chosen].toarray(), expected, atol=tolerance)

    def test_of_lengths(self) -> None:
        fitter = fitter_of(model())
        positions = wobbled(fitter.model.rest)
        jacobian, _ = fitter._length_rows(positions)
        expected = numeric(lambda x: fitter._length_rows(x)[1], positions, self.chosen)
        np.testing.assert_allclose(jacobian[:, self.chosen].toarray(), expected, rtol=1e-4, atol=1e-2)

    def test_of_bending_of_a_flat_sheet(self) -> None:
        fitter = fitter_of(model())
        positions = wobbled(fitter.model.rest, 1e-7)
        jacobian, _ = fitter._bending_rows(positions)
        expected = numeric(lambda x: fitter._bending_rows(x)[1], positions, self.chosen, step=1e-7)
        np.testing.assert_allclose(jacobian[:, self.chosen].toarray(), expected, rtol=1e-3, atol=1e-2)

    def test_all_misses_are_zero_at_rest_and_the_gradient_too(self) -> None:
        fitter, view = fitter_of(model()), camera()
        rest = fitter.model.rest
        seen = sightings_of(fitter, rest, view)
        _, residuals, _, gradient = fitter._system(view, seen, rest, rest, np.full(len(rest), 0.01))
        np.testing.assert_allclose(residuals, 0, atol=1e-9)
        np.testing.assert_allclose(gradient, 0, atol=1e-9)


class TestTerms:
    def test_rigid_motion_costs_neither_length_nor_bending(self) -> None:
        bent = replace(model(), rest=rolled(model().rest, 0.08))
        fitter = fitter_of(bent)
        turn = Rotation.from_rotvec([0.3, 1.0, -0.5]).as_matrix()
        moved = bent.rest @ turn.T + [0.1, 0.2, 0.3]
        np.testing.assert_allclose(fitter._length_rows(moved)[1], 0, atol=1e-9)
        # Only the part of a gap along the normal is kept; the rest of it is thousandths of a deviation.
        np.testing.assert_allclose(fitter._bending_rows(moved)[1], 0, atol=0.01)

    def test_stretch_costs_more_than_shortening(self) -> None:
        fitter = fitter_of(model())
        long, short = fitter._length_rows(1.05 * fitter.model.rest)[1], fitter._length_rows(0.95 * fitter.model.rest)[1]
        np.testing.assert_allclose(long, 5, rtol=1e-6)
        np.testing.assert_allclose(short, -2.5, rtol=1e-6)

    def test_rolling_costs_no_length(self) -> None:
        # A chord is shorter than its arc by (angle / 2)^2 / 6 = 1.5e-3 at 6 mm on 30 mm radius.
        fitter = fitter_of(model())
        assert np.abs(fitter._length_rows(rolled(fitter.model.rest, 0.03))[1]).max() < 0.5

    def test_skins_are_a_thickness_apart_and_the_first_is_towards_the_camera(self) -> None:
        fitter = fitter_of(model(thickness=0.006))
        rest = fitter.model.rest
        up, down = fitter.skin(rest, 1.0), fitter.skin(rest, -1.0)
        np.testing.assert_allclose(up - rest, np.tile([0, 0, 0.003], (len(rest), 1)), atol=1e-9)
        np.testing.assert_allclose(up - down, np.tile([0, 0, 0.006], (len(rest), 1)), atol=1e-9)

    def test_triangles_turn_away_from_the_camera(self) -> None:
        mesh, rest = mesh_and_rest()
        assert (vertex_normals(mesh.triangles, rest)[:, 2] < 0).all()


class TestFit:
    def test_exact_sightings_of_the_rest_change_nothing(self) -> None:
        fitter, view = fitter_of(model()), camera()
        rest = fitter.model.rest
        found = fitter.fit(view, sightings_of(fitter, rest, view), rest, np.full(len(rest), LOOSE), 3, rest)
        np.testing.assert_allclose(found.positions, rest, atol=1e-7)
        np.testing.assert_allclose(found.residual, 0, atol=1e-4)

    @pytest.mark.parametrize("thickness", [0.0, 0.004])
    def test_bent_sheet_is_tracked_to_less_than_a_millimetre(self, thickness: float) -> None:
        # Far above any table.
        for error in self.errors_while_bending(model(thickness=thickness, lowest=-1.0)):
            assert error.mean() < 0.001
            assert error.max() < 0.002

    def test_the_table_holds_only_what_is_hardly_lifted(self) -> None:
        errors = self.errors_while_bending(model())
        assert max(error.mean() for error in errors) < 0.002
        assert errors[-1].mean() < 0.0005

    def errors_while_bending(self, sheet: SurfaceModel) -> list[np.ndarray]:
        """[W] metres each: tracked from view to view while it is rolled up to a radius of 75 mm."""
        fitter, view = fitter_of(sheet), camera()
        positions, errors = sheet.rest, []
        for radius in 1.2 / np.arange(1, 17):
            true = rolled(sheet.rest, radius)
            seen = sightings_of(fitter, true, view, noise=0.1)
            positions = fitter.fit(view, seen, positions, np.full(len(true), 0.02), 6, positions).positions
            errors.append(np.linalg.norm(positions - true, axis=1))
        return errors

    def test_wrong_sightings_are_outvoted(self) -> None:
        fitter, view = fitter_of(model()), camera()
        true = rolled(fitter.model.rest, 0.15)
        seen = sightings_of(fitter, true, view)
        off = np.random.default_rng(1).random(len(seen.pixels)) < 0.2
        seen = replace(seen, pixels=seen.pixels + off[:, None] * np.array([25.0, -18]))
        start = rolled(fitter.model.rest, 0.18)
        found = fitter.fit(view, seen, start, np.full(len(true), 0.02), 12, start)
        assert np.linalg.norm(found.positions - true, axis=1).mean() < 0.002
        assert np.median(found.residual[off]) > 20
        assert np.median(found.residual[~off]) < 1

    def test_turning_the_scene_turns_the_result(self) -> None:
        fitter, view = fitter_of(model(lowest=-1.0)), camera()
        rest = fitter.model.rest
        seen = sightings_of(fitter, rolled(rest, 0.2), view, noise=0.3)
        motion = np.full(len(rest), 0.05)
        found = fitter.fit(view, seen, rest, motion, 4, rest)
        # About the vertical: the table stays level.
        turn, shift = Rotation.from_rotvec([0, 0, 2.0]).as_matrix(), np.array([3.0, -1, 0])
        pose = view.world_from_camera.copy()
        pose[:3, :3], pose[:3, 3] = turn @ pose[:3, :3], turn @ pose[:3, 3] + shift
        turned = fitter_of(replace(fitter.model, rest=rest @ turn.T + shift))
        again = turned.fit(replace(view, world_from_camera=pose), seen, turned.model.rest, motion, 4, turned.model.rest)
        np.testing.assert_allclose(again.positions, found.positions @ turn.T + shift, atol=1e-6)
        np.testing.assert_allclose(again.residual, found.residual, atol=1e-4)

    def test_nothing_seen_keeps_the_prediction(self) -> None:
        fitter, view = fitter_of(model(lowest=-1.0)), camera()
        predicted = fitter.model.rest + [0.01, 0, 0.02]
        found = fitter.fit(view, none_seen(), predicted, np.full(len(predicted), 0.01), 4, fitter.model.rest)
        np.testing.assert_allclose(found.positions, predicted, atol=1e-6)
        assert found.residual.shape == (0,)
        assert np.isfinite(found.sigma).all()

    def test_nothing_sinks_into_the_table(self) -> None:
        fitter, view = fitter_of(model()), camera()
        predicted = fitter.model.rest - [0, 0, 0.02]
        found = fitter.fit(view, none_seen(), predicted, np.full(len(predicted), 0.01), 6, fitter.model.rest)
        assert found.positions[:, 2].min() > -0.001

    def test_unseen_vertices_are_less_sure(self) -> None:
        fitter, view = fitter_of(model(lowest=-1.0)), camera()
        rest = fitter.model.rest
        seen = sightings_of(fitter, rest, view)
        left = (rest[seen.corners, 0] < 0).all(axis=1)
        half = Correspondences(**{name: getattr(seen, name)[left] for name in seen.__dataclass_fields__})
        found = fitter.fit(view, half, rest, np.full(len(rest), 0.01), 3, rest)
        assert found.sigma[rest[:, 0] > 0.04].min() > 1.5 * np.median(found.sigma[rest[:, 0] < -0.02])

    def test_stated_deviation_is_that_of_repeated_noise(self) -> None:
        fitter, view = fitter_of(model(lowest=-1.0, spacing=14.0)), camera()
        rest = fitter.model.rest
        exact = sightings_of(fitter, rest, view)
        random, errors = np.random.default_rng(3), []
        for _ in range(40):
            seen = replace(exact, pixels=exact.pixels + random.normal(0, 0.3, exact.pixels.shape))
            found = fitter.fit(view, seen, rest, np.full(len(rest), LOOSE), 2, rest)
            errors.append(found.positions - rest)
        # Twelve samples give the deviation to within 12 %, forty repeats the spread to within 6 %.
        spread = np.sqrt((np.array(errors) ** 2).mean(axis=0).sum(axis=1))
        assert 0.5 < np.median(spread / found.sigma) < 1.6

    def test_far_start_stays_finite(self) -> None:
        fitter, view = fitter_of(model()), camera()
        rest = fitter.model.rest
        start = wobbled(rest, 0.05)
        found = fitter.fit(view, sightings_of(fitter, rest, view), start, np.full(len(rest), 0.05), 8, start)
        assert np.isfinite(found.positions).all()

    def test_same_input_gives_the_same_result(self) -> None:
        fitter, view = fitter_of(model()), camera()
        rest = fitter.model.rest
        seen = sightings_of(fitter, rest, view, noise=0.3)
        one, other = (fitter.fit(view, seen, rest, np.full(len(rest), 0.01), 2, rest) for _ in range(2))
        np.testing.assert_array_equal(one.sigma, other.sigma)
        np.testing.assert_array_equal(one.positions, other.positions)
