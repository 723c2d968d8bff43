"""Shape of a resting surface from the parallax of a moving camera whose poses are known.

The unknowns are the inverse depths w of the mesh vertices in the reference view. Inverse depth is linear in the image
over any plane, so a place inside a triangle has the barycentric mean of its corners' inverse depths, and the smoothness
prior (the gaps of the hinges, see `hinge_gaps`) costs nothing on planes whatever their slant.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from egophys_core.perception.robust import cauchy_weights
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_mesh import SurfaceMesh, hinge_gaps

PIXEL_SIGMA = 0.7
"""Pixels: error of a track in one view; larger than that of a single match, as errors of views are alike."""

ROUGHNESS_M = 0.0006
"""Metres: how far the diagonals of two neighbouring triangles pass each other."""

BELOW_TABLE_M = 0.0005
"""Metres: how deep a vertex may lie in the table."""

ITERATIONS = 12


@dataclass(frozen=True, kw_only=True)
class RestSurface:
    """A surface at rest."""

    positions: np.ndarray
    """[V, 3] metres, frame world."""
    inverse: np.ndarray
    """[V] 1/m: inverse depths along the optical axis of the reference view."""
    depth_sigma: np.ndarray
    """[V] metres: standard deviation along the ray of the reference view."""
    residual: np.ndarray
    """[T] pixels: median distance of tracked and projected points in each view; NaN where nothing was tracked."""


def surface_from_parallax(
    mesh: SurfaceMesh,
    views: list[View],
    triangle: np.ndarray,
    weights: np.ndarray,
    tracks: np.ndarray,
    table_height: float,
    shape: np.ndarray | None = None,
) -> RestSurface:
    """Least squares for the inverse depths, robust against wrong tracks.

    Args:
        mesh: made in the first view.
        views: T views with known poses, the reference first.
        triangle: [M] int, the triangle of each tracked place (see `locate`).
        weights: [M, 3] barycentric coordinates.
        tracks: [T, M, 2] pixels; NaN where not tracked.
        table_height: z of the table, metres.
        shape: [V] 1/m: inverse depths that cost nothing, up to a plane; None for planes alone.
    """
    reference = views[0]
    centre = reference.world_from_camera[:3, 3]
    rays = rays_of_pixels(mesh.pixels, reference)
    to_places = sparse.csr_matrix(
        (weights.ravel(), (np.repeat(np.arange(len(triangle)), 3), mesh.triangles[triangle].ravel())),
        shape=(len(triangle), len(mesh.pixels)),
    )
    place_rays = rays_of_pixels(to_places @ mesh.pixels, reference)
    # The table under every pixel is the farthest that it may be, and where the search starts.
    drop = centre[2] - table_height
    table_inverse = np.maximum(-rays[:, 2] / drop, 1e-3)
    inverse = table_inverse.copy()
    gaps = hinge_gaps(mesh.hinges, mesh.pixels)
    free = np.zeros(len(inverse)) if shape is None else shape
    for _ in range(ITERATIONS):
        at_places = to_places @ inverse
        gradient, curvature = np.zeros(len(triangle)), np.zeros(len(triangle))
        for view, observed in zip(views, tracks, strict=True):
            residual, slope = _residuals(view, centre, place_rays, at_places, observed)
            squared = np.nan_to_num((residual**2).sum(axis=1), nan=np.inf)
            weight = cauchy_weights(squared, 2 * PIXEL_SIGMA) / PIXEL_SIGMA**2
            gradient += np.nansum(weight[:, None] * slope * residual, axis=1)
            curvature += np.nansum(weight[:, None] * slope * slope, axis=1)
        # Lengths become inverse depths by dw = w^2 dz.
        roughness = sparse.diags(1 / (ROUGHNESS_M * (inverse**2)[mesh.hinges[:, 0]])) @ gaps
        below = np.where(inverse < table_inverse, 1 / (BELOW_TABLE_M * inverse**2), 0.0)
        information = (
            to_places.T @ sparse.diags(curvature) @ to_places
            + roughness.T @ roughness
            + sparse.diags(below**2 + 1e-9 / inverse**2)
        )
        slope_total = (
            to_places.T @ gradient + roughness.T @ (roughness @ (inverse - free)) + below**2 * (inverse - table_inverse)
        )
        solver = splu(information.tocsc())
        inverse = np.clip(inverse - solver.solve(slope_total), 0.2 * table_inverse, 2.0 * table_inverse)
    sigma = np.sqrt(np.maximum(np.diag(solver.solve(np.eye(len(inverse)))), 0)) / inverse**2
    at_places = to_places @ inverse
    median_residuals = [
        np.nanmedian(np.linalg.norm(_residuals(view, centre, place_rays, at_places, observed)[0], axis=1))
        if np.isfinite(observed).any()
        else np.nan
        for view, observed in zip(views, tracks, strict=True)
    ]
    return RestSurface(
        positions=centre + rays / inverse[:, None],
        inverse=inverse,
        depth_sigma=sigma,
        residual=np.array(median_residuals),
    )


def rays_of_pixels(pixels: np.ndarray, view: View) -> np.ndarray:
    """[N, 3] directions in the world through pixels [N, 2], with length 1 along the optical axis."""
    matrix = view.camera_matrix
    in_camera = np.column_stack([(pixels - matrix[:2, 2]) / matrix.diagonal()[:2], np.ones(len(pixels))])
    return in_camera @ view.world_from_camera[:3, :3].T


def _residuals(
    view: View, centre: np.ndarray, rays: np.ndarray, inverse: np.ndarray, observed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Projected less observed [M, 2] pixels, and its derivative by the inverse depth."""
    rotation = view.world_from_camera[:3, :3]
    # Scaled by the inverse depth, a point is ray + w (centre - camera): linear in w.
    shift = (centre - view.world_from_camera[:3, 3]) @ rotation
    scaled = rays @ rotation + inverse[:, None] * shift
    depth = np.maximum(scaled[:, 2:], 1e-6)
    flat = scaled[:, :2] / depth
    focal = view.camera_matrix.diagonal()[:2]
    slope = focal * (shift[:2] - flat * shift[2]) / depth
    return focal * flat + view.camera_matrix[:2, 2] - observed, slope
