"""Texture that comes into view as a solid turns: pictures of it from later views, with features where it is new."""

from collections.abc import Sequence

import numpy as np

from egophys_core.perception.stages import Masks
from egophys_core.perception.surface.feature_search import RenderedSurface, may_show
from egophys_core.perception.surface.surface_mesh import SurfaceTexture

SLANTED = 0.4
"""A triangle that every picture shows with less than this share of its area now counts as new."""

NEW_SHARE = 0.15
"""Share of the visible surface that is new for which another picture is kept."""

MOST_FEATURES = 300
FINEST_STEP_PX = 3
"""Of one picture: number of features, and their distance in it."""


def revealed(
    known: Sequence[SurfaceTexture], scene: RenderedSurface, evened: np.ndarray, masks: Masks
) -> SurfaceTexture | None:
    """A picture of what the known ones do not show, or do not show well; None if that is little.

    Args:
        known: pictures of the surface.
        scene: the surface where it is in the view.
        evened: [S, S] uint8: the view with even contrast.
        masks: of the view.
    """
    flat = scene.corners[:, :, :2]
    best = np.max([_areas(each.corners) for each in known], axis=0)
    is_new = best < SLANTED * _areas(flat)
    triangle = scene.rendering.triangle
    shown = scene.rendering.silhouette & masks.object & may_show(masks)
    new = shown & is_new[triangle]
    count = np.count_nonzero(new)
    if count <= NEW_SHARE * np.count_nonzero(shown):
        return None
    step = max(FINEST_STEP_PX, int(np.ceil(np.sqrt(count / MOST_FEATURES))))
    rows, columns = np.indices(new.shape)
    chosen = new & (rows % step == 0) & (columns % step == 0)
    visible = np.zeros(len(flat), bool)
    visible[triangle[shown]] = True
    return SurfaceTexture(
        image=evened,
        corners=np.where(visible[:, None, None], flat, np.nan),
        least_surface=known[-1].least_surface,
        first=known[-1].end,
        feature_pixels=np.column_stack([columns[chosen], rows[chosen]]).astype(float),
        feature_triangles=triangle[chosen],
        feature_weights=scene.rendering.weights[chosen[scene.rendering.silhouette]],
    )


def _areas(corners: np.ndarray) -> np.ndarray:
    """[F] square pixels of triangles [F, 3, 2]; 0 where NaN."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.nan_to_num(np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / 2)
