"""Motion and deformation of solids: rigid motion is found exactly, and stretch rather than approach."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.perception.stages import View
from egophys_core.perception.surface.body_fit import BodyFitter, body_fitter_of
from egophys_core.perception.surface.surface_fit import Correspondences, FittedSurface, SurfaceModel
from egophys_core.perception.surface.surface_mesh import mesh_of_mask
from egophys_core.perception.surface.surface_render import project

K = np.array([[500.0, 0, 199.5], [0, 500.0, 199.5], [0, 0, 1]])
RADII = np.array([0.08, 0.05, 0.04])
COUNT = 300


def camera() -> View:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("x", 180 + 35, degrees=True).as_matrix()
    pose[:3, 3] = [0.0, -0.35, 0.55]
    return View(stamp_ns=0, image=np.zeros((400, 400, 3), np.uint8), camera_matrix=K, world_from_camera=pose)


def body() -> BodyFitter:
    """Points of an ellipsoid that lies on the table."""
    around = np.random.default_rng(0).normal(size=(COUNT, 3))
    rest = RADII * around / np.linalg.norm(around, axis=1, keepdims=True) + [0, 0, RADII[2]]
    mask = np.zeros((40, 40), bool)
    mask[5:35, 5:35] = True
    mesh = mesh_of_mask(mask, 8.0)
    return body_fitter_of(
        SurfaceModel(
            mesh=mesh,
            rest=rest,
            triangles=mesh.triangles,
            thickness=0.0,
            stretch_sigma=0.03,
            shortening_sigma=0.03,
            bending_sigma=0.0015,
            lowest=0.0,
        )
    )


def seen(places: np.ndarray, shown: np.ndarray, sigma: float = 1.0) -> Correspondences:
    """The points where they project, without error."""
    view, weights = camera(), np.zeros((len(shown), 3))
    weights[:, 0] = 1
    return Correspondences(
        corners=np.repeat(shown[:, None], 3, axis=1),
        weights=weights,
        side=np.ones(len(shown)),
        pixels=project(places[shown], view.camera_matrix, view.world_from_camera)[:, :2],
        sigma=np.full(len(shown), sigma),
        robust_scale=np.full(len(shown), 2 * sigma),
    )


def fitted(fitter: BodyFitter, correspondences: Correspondences, start: np.ndarray | None = None) -> FittedSurface:
    begin = fitter.model.rest if start is None else start
    return fitter.fit(camera(), correspondences, begin, np.full(COUNT, 0.02), 12, begin)


def moved(rest: np.ndarray) -> np.ndarray:
    turn = Rotation.from_rotvec([0.1, -0.15, 0.2]).as_matrix()
    return (rest - rest.mean(axis=0)) @ turn.T + rest.mean(axis=0) + [0.01, -0.015, 0.05]


UPPER = np.arange(0, COUNT, 2)


def test_a_rigid_motion_is_found_and_moves_what_is_not_seen() -> None:
    fitter = body()
    true = moved(fitter.model.rest)
    found = fitted(fitter, seen(true, UPPER, 0.3))
    assert np.linalg.norm(found.positions - true, axis=1).max() < 0.002
    assert np.median(found.residual) < 0.1
    assert (found.sigma > 0).all()


def test_wrong_places_do_not_matter() -> None:
    fitter = body()
    true = moved(fitter.model.rest)
    given = seen(true, UPPER, 0.3)
    given.pixels[::6] += [25, -10]
    found = fitted(fitter, given)
    assert np.linalg.norm(found.positions - true, axis=1).max() < 0.004


def test_from_view_to_view_nothing_drifts() -> None:
    fitter = body()
    positions = fitter.model.rest
    for step in range(1, 31):
        true = fitter.model.rest + [0, 0, 0.003 * step]
        given = seen(true, UPPER)
        given.pixels[:] += np.random.default_rng(step).normal(0, 0.5, given.pixels.shape)
        positions = fitted(fitter, given, positions).positions
    assert np.linalg.norm(positions - true, axis=1).max() < 0.006


@pytest.mark.parametrize("stretch", [1.12, 1.0])
def test_stretch_along_one_line_is_stretch(stretch: float) -> None:
    fitter = body()
    true = fitter.model.rest * [stretch, 1, 1] + [0, 0, 0.1]
    start = fitter.model.rest + [0, 0, 0.1]
    for _ in range(6):
        start = fitted(fitter, seen(true, UPPER, 0.5), start).positions
    length = np.ptp(start[:, 0]) / np.ptp(fitter.model.rest[:, 0])
    assert length == pytest.approx(stretch, abs=0.03)


def test_nothing_seen_stays_with_the_prediction_and_is_not_sure() -> None:
    fitter = body()
    true = moved(fitter.model.rest)
    nothing, good = fitted(fitter, seen(true, UPPER[:0]), true), fitted(fitter, seen(true, UPPER), true)
    np.testing.assert_allclose(nothing.positions, true, atol=1e-6)
    assert nothing.sigma.min() > 0.02
    assert good.sigma.max() < 0.5 * nothing.sigma.min()


def test_the_table_holds_what_would_sink() -> None:
    fitter = body()
    deep = fitter.model.rest - [0, 0, 0.05]
    found = fitted(fitter, seen(deep, UPPER[:0]), deep)
    assert found.positions[:, 2].min() > deep[:, 2].min() + 0.02
