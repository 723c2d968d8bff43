"""Which triangle of a surface each pixel shows, and the reference texture laid over it."""

from dataclasses import dataclass

import cv2
import numpy as np

NO_TRIANGLE = -1


@dataclass(frozen=True, kw_only=True)
class Rendering:
    """A surface as one view would show it, without anything else in the scene."""

    triangle: np.ndarray
    """[H, W] int32: index of the nearest triangle, -1 where there is none."""
    weights: np.ndarray
    """[P, 3] float64: barycentric coordinates of the P pixels with a triangle, row by row."""

    @property
    def silhouette(self) -> np.ndarray:
        """[H, W] bool."""
        return self.triangle >= 0

    def source(self, corners: np.ndarray) -> np.ndarray:
        """[H, W, 2] float32: the pixel x, y of a picture of the surface that is seen; NaN where there is none.

        Args:
            corners: [F, 3, 2] pixels of the triangles' corners in that picture; NaN for those that it does not show.
        """
        source = np.full((*self.triangle.shape, 2), np.nan, np.float32)
        painted = self.silhouette
        source[painted] = np.einsum("nk,nkd->nd", self.weights, corners[self.triangle[painted]])
        return source


def project(positions: np.ndarray, camera_matrix: np.ndarray, world_from_camera: np.ndarray) -> np.ndarray:
    """Pixels and depths of points.

    Args:
        positions: [N, 3] metres, frame world.
        camera_matrix: [3, 3] pixels.
        world_from_camera: [4, 4] metres.

    Returns:
        [N, 3]: x and y in pixels, and depth along the optical axis in metres (not positive behind the camera, where the
        pixels mean nothing).
    """
    in_camera = (positions - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    depth = in_camera[:, 2]
    safe = np.where(np.abs(depth) > 1e-9, depth, 1e-9)
    pixels = in_camera[:, :2] / safe[:, None] @ camera_matrix[:2, :2].T + camera_matrix[:2, 2]
    return np.column_stack([pixels, depth])


def facing(corners: np.ndarray) -> np.ndarray:
    """[F] bool: triangles [F, 3, 3] (pixels and depth) that show the side that the reference view shows."""
    one, other = (corners[:, k, :2] - corners[:, 0, :2] for k in (1, 2))
    return one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0] > 0


def render(corners: np.ndarray, size: tuple[int, ...]) -> Rendering:
    """Paint the triangles from far to near.

    Args:
        corners: [F, 3, 3], pixels and depth of each triangle's corners (see `project`); those with NaN are left out.
        size: height and width of the view.
    """
    depth = corners[:, :, 2]
    flat = corners[:, :, :2]
    usable = np.isfinite(corners).all(axis=(1, 2)) & (depth > 0).all(axis=1)
    usable &= (np.abs(flat) < 1e4).all(axis=(1, 2))
    painted = np.full(size, NO_TRIANGLE, np.int32)
    order = np.flatnonzero(usable)
    order = order[np.argsort(-depth[order].mean(axis=1))]
    fixed = np.rint(flat[order] * 16).astype(np.int32)  # four fractional bits
    for index, corner in zip(order.tolist(), fixed, strict=True):
        cv2.fillConvexPoly(painted, corner, index, shift=4)
    rows, columns = np.nonzero(painted >= 0)
    weights = barycentric(flat[painted[rows, columns]], np.column_stack([columns, rows]))
    # Pixels are painted up to a fraction of one wide of the triangle; its texture goes on a little.
    weights = np.clip(weights, -0.25, 1.25)
    return Rendering(triangle=painted, weights=weights / weights.sum(axis=1, keepdims=True))


def barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[N, 3] coordinates of points [N, 2] in triangles [N, 3, 2], one each; thirds where a triangle has no area."""
    origin = corners[:, 0]
    one, other, place = corners[:, 1] - origin, corners[:, 2] - origin, points - origin
    area = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    flat = np.abs(area) < 1e-9
    safe = np.where(flat, 1.0, area)
    second = (place[:, 0] * other[:, 1] - place[:, 1] * other[:, 0]) / safe
    third = (one[:, 0] * place[:, 1] - one[:, 1] * place[:, 0]) / safe
    weights = np.column_stack([1 - second - third, second, third])
    weights[flat] = 1 / 3
    return weights


def textured(source: np.ndarray, picture: np.ndarray, background: np.ndarray) -> np.ndarray:
    """[H, W] uint8: a picture laid over the surface where it shows it (`Rendering.source`), before a background."""
    x, y = np.moveaxis(np.nan_to_num(source, nan=-1.0), -1, 0)
    laid = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(np.isfinite(source[..., 0]), laid, background)
