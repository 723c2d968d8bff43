"""Depth from the parallax of a moving camera, against planes and spheres."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.perception.camera.parallax import RestSurface, _residuals, rays_of_pixels, surface_from_parallax
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_mesh import SurfaceMesh, boundary_edges, locate, mesh_of_mask
from egophys_core.perception.surface.surface_render import project

K = np.array([[300.0, 0, 59.5], [0, 300.0, 59.5], [0, 0, 1]])
TABLE = 0.0
VIEWS = 10


def view(centre: tuple[float, float, float], turn: tuple[float, float, float] = (0, 0, 0)) -> View:
    """Looking down on the table."""
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1, -1]) @ Rotation.from_rotvec(turn).as_matrix()
    pose[:3, 3] = centre
    return View(stamp_ns=0, image=np.zeros((120, 120, 3), np.uint8), camera_matrix=K, world_from_camera=pose)


def views(way: float = 0.08) -> list[View]:
    shares = np.linspace(0, 1, VIEWS)
    return [view((way * s, 0.3 * way * s * s, 0.5 + 0.02 * s), (0.02 * s, 0.05 * s, 0)) for s in shares]


Height = Callable[[np.ndarray, np.ndarray], np.ndarray]


def dome(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.maximum(0.09**2 - x * x - y * y, 0)) - 0.02)


def level(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.03 + 0 * x


def slanted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.06 + 0.3 * x - 0.2 * y


def on_surface(pixels: np.ndarray, height: Height) -> np.ndarray:
    """Where the rays of the first view meet a surface, by bisection along each ray."""
    first = views()[0]
    rays, centre = rays_of_pixels(pixels, first), first.world_from_camera[:3, 3]
    near, far = np.full(len(rays), 0.2), np.full(len(rays), 0.5)
    for _ in range(60):
        middle = (near + far) / 2
        place = centre + middle[:, None] * rays
        above = place[:, 2] > height(place[:, 0], place[:, 1])
        near, far = np.where(above, middle, near), np.where(above, far, middle)
    return centre + far[:, None] * rays


def solved(
    height: Height, *, noise: float = 0.0, wrong: float = 0.0, way: float = 0.08, missing: float = 0.0
) -> tuple[SurfaceMesh, RestSurface, np.ndarray]:
    y, x = np.mgrid[:120, :120] - 59.5
    mask = x * x + y * y < 32**2
    mesh = mesh_of_mask(mask, 6.0)
    places = np.column_stack(np.nonzero(mask))[::7, ::-1].astype(float)
    triangle, weights = locate(mesh, places)
    places, triangle, weights = places[triangle >= 0], triangle[triangle >= 0], weights[triangle >= 0]
    world = on_surface(places, height)
    random = np.random.default_rng(0)
    tracks = np.array([project(world, each.camera_matrix, each.world_from_camera)[:, :2] for each in views(way)])
    tracks[1:] += random.normal(0, noise, tracks[1:].shape)
    off = random.random(len(places)) < wrong
    tracks[1:, off] += random.uniform(5, 20, (VIEWS - 1, np.count_nonzero(off), 2))
    tracks[1:][random.random(tracks[1:].shape[:2]) < missing] = np.nan
    return (
        mesh,
        surface_from_parallax(mesh, views(way), triangle, weights, tracks, TABLE),
        on_surface(mesh.pixels, height),
    )


@pytest.mark.parametrize("height", [level, slanted])
def test_planes_come_out_exactly_without_noise(height: Height) -> None:
    _, rest, true = solved(height)
    np.testing.assert_allclose(rest.positions, true, atol=1e-5)
    assert rest.residual.max() < 1e-3


def test_a_sphere_comes_out_to_half_a_millimetre() -> None:
    mesh, rest, true = solved(dome)
    inner = np.setdiff1d(np.arange(len(true)), boundary_edges(mesh.triangles))
    error = np.linalg.norm(rest.positions - true, axis=1)
    assert error[inner].mean() < 5e-4
    assert error.max() < 2e-3


@pytest.mark.parametrize("height", [level, slanted, dome])
def test_errors_are_within_the_stated_deviation(height: Height) -> None:
    _, rest, true = solved(height, noise=0.3)
    depth = np.abs(rest.positions - true) @ [0, 0, 1.0]
    assert (depth < 3 * rest.depth_sigma + 3e-4).mean() > 0.97
    assert np.median(rest.residual[1:]) == pytest.approx(0.3 * np.sqrt(2 * np.log(2)), rel=0.25)


def test_wrong_tracks_are_outvoted() -> None:
    _, rest, true = solved(dome, noise=0.1, wrong=0.15)
    assert np.median(np.linalg.norm(rest.positions - true, axis=1)) < 1e-3


def test_missing_tracks_do_no_harm() -> None:
    _, rest, true = solved(slanted, noise=0.1, missing=0.5)
    assert np.linalg.norm(rest.positions - true, axis=1).max() < 2e-3


def test_a_longer_way_of_the_camera_is_surer() -> None:
    near, far = (solved(level, noise=0.2, way=way)[1] for way in (0.02, 0.1))
    assert np.median(far.depth_sigma) < 0.5 * np.median(near.depth_sigma)


def test_without_tracks_it_lies_on_the_table_and_is_unsure() -> None:
    _, rest, _ = solved(level, missing=1.0)
    np.testing.assert_allclose(rest.positions[:, 2], TABLE, atol=1e-6)
    assert np.isnan(rest.residual[1:]).all()
    assert np.isfinite(rest.positions).all()


def test_never_deep_in_the_table() -> None:
    _, rest, _ = solved(lambda x, y: -0.02 + 0 * x)
    assert rest.positions[:, 2].min() > -0.015


def test_points_stay_on_their_rays() -> None:
    mesh, rest, _ = solved(dome, noise=0.5)
    first = views()[0]
    np.testing.assert_allclose(project(rest.positions, K, first.world_from_camera)[:, :2], mesh.pixels, atol=1e-6)


def test_derivative_by_the_inverse_depth() -> None:
    first, other = views()[0], views()[-1]
    pixels = np.random.default_rng(3).uniform(10, 110, (12, 2))
    rays, centre = rays_of_pixels(pixels, first), first.world_from_camera[:3, 3]
    inverse, step = np.linspace(1.8, 3.0, 12), 1e-5
    _, slope = _residuals(other, centre, rays, inverse, pixels)
    up, _ = _residuals(other, centre, rays, inverse + step, pixels)
    down, _ = _residuals(other, centre, rays, inverse - step, pixels)
    np.testing.assert_allclose(slope, (up - down) / (2 * step), rtol=1e-6, atol=1e-6)


def test_rays_project_back() -> None:
    each = views()[4]
    pixels = np.array([[0.0, 0], [119, 3], [60, 60]])
    points = each.world_from_camera[:3, 3] + 0.4 * rays_of_pixels(pixels, each)
    np.testing.assert_allclose(
        project(points, K, each.world_from_camera), np.column_stack([pixels, [0.4] * 3]), atol=1e-9
    )
