"""The hidden side of solids: symmetric bodies close on themselves."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.perception.stages import View
from egophys_core.perception.surface.completion import ClosedSurface, close_surface
from egophys_core.perception.surface.surface_mesh import SurfaceMesh, boundary_edges, mesh_of_mask

RADII = np.array([0.08, 0.06, 0.04])
TABLE = 0.01


def view_from(eye: tuple[float, float, float], target: tuple[float, float, float]) -> View:
    forward = np.array(target) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1]) if abs(forward[2]) < 0.99 else np.array([1.0, 0, 0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.column_stack([right, np.cross(forward, right), forward]), eye
    matrix = np.array([[500.0, 0, 250], [0, 500, 250], [0, 0, 1]])
    return View(stamp_ns=0, image=np.zeros((500, 500, 3), np.uint8), camera_matrix=matrix, world_from_camera=pose)


ABOVE = view_from((0.2, 0.1, 5.0), (0.2, 0.1, 0.0))


def disc_mesh() -> SurfaceMesh:
    y, x = np.mgrid[:101, :101] - 50.0
    return mesh_of_mask(x * x + y * y <= 45**2, 5.0)


def upper_half() -> tuple[SurfaceMesh, np.ndarray]:
    """A lying ellipsoid seen from right above: its upper half."""
    mesh = disc_mesh()
    flat = (mesh.pixels - 50) / 45.6
    up = np.sqrt(np.maximum(1 - (flat**2).sum(axis=1), 0))
    return mesh, RADII * np.column_stack([flat[:, 0], -flat[:, 1], up]) + [0.2, 0.1, TABLE + RADII[2]]


def closed() -> tuple[SurfaceMesh, np.ndarray, ClosedSurface]:
    mesh, visible = upper_half()
    return mesh, visible, close_surface(mesh, visible, TABLE, ABOVE)


def test_an_ellipsoid_closes_on_itself() -> None:
    _, visible, found = closed()
    unit = (found.positions - [0.2, 0.1, TABLE + RADII[2]]) / RADII
    np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1, atol=0.04)
    np.testing.assert_array_equal(found.positions[: len(visible)], visible)
    assert found.positions[:, 2].min() == pytest.approx(TABLE, abs=0.001)


def test_a_box_gets_its_lower_corners() -> None:
    mesh = disc_mesh()
    flat = (mesh.pixels - 50) / 45.6
    # Seen from above and the front: the top where y > 0, the front below.
    top = flat[:, 1] < 0
    places = np.column_stack(
        [0.1 * flat[:, 0], np.where(top, -0.1 * flat[:, 1], 0), np.where(top, 0.08, 0.08 * (1 - flat[:, 1]))]
    )
    found = close_surface(mesh, places, 0.0, view_from((0, -3.0, 3.0), (0, 0, 0.04)))
    hidden = found.positions[len(places) :]
    assert hidden[:, 2].min() >= 0
    assert hidden[:, 2].max() <= 0.08 + 1e-9
    assert hidden[:, 1].max() > 0.05


def test_nothing_stands_where_the_view_would_show_it() -> None:
    mesh = disc_mesh()
    flat = (mesh.pixels - 50) / 45.6
    # The far end of the top is taken to be farther away than it is, so that its image lies before the front.
    top = np.maximum(-flat[:, 1], 0)
    places = np.column_stack([0.1 * flat[:, 0], 0.1 * top + 0.2 * top**4, 0.08 * (1 - np.maximum(flat[:, 1], 0))])
    rim = places[np.unique(boundary_edges(mesh.triangles))]
    hidden = close_surface(mesh, places, 0.0, view_from((0, -3.0, 3.0), (0, 0, 0.04))).positions[len(places) :]
    assert (2 * rim.mean(axis=0) - places)[:, 1].min() < -0.02
    assert hidden[:, 1].min() > -0.008


def test_nothing_lies_below_the_table() -> None:
    mesh, visible = upper_half()
    for table in (TABLE, TABLE + 0.03, TABLE + 0.07):
        found = close_surface(mesh, visible, table, ABOVE)
        assert found.positions[len(visible) :, 2].min() >= table


def test_triangles_of_both_sides_turn_alike_as_seen_from_outside() -> None:
    _, _, found = closed()
    corners = found.positions[found.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = ((corners.mean(axis=1) - found.positions.mean(axis=0)) * normals).sum(axis=1)
    assert len(found.triangles) == 2 * len(disc_mesh().triangles)
    # Those of the mesh turn clockwise, so that their normals point inside.
    assert (outward < 0).mean() > 0.98


def test_a_turned_object_gets_the_turned_side() -> None:
    mesh, visible, found = closed()
    cos, sin = np.cos(0.7), np.sin(0.7)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = turn, [1, 2, 0]
    view = replace(ABOVE, world_from_camera=move @ ABOVE.world_from_camera)
    again = close_surface(mesh, visible @ turn.T + [1, 2, 0], TABLE, view)
    np.testing.assert_allclose(again.positions, found.positions @ turn.T + [1, 2, 0], atol=1e-9)


def test_flat_on_the_table_stays_finite() -> None:
    mesh, visible = upper_half()
    visible[:, 2] = TABLE
    assert np.isfinite(close_surface(mesh, visible, TABLE, ABOVE).positions).all()
