"""What the table looks like where nothing stands on it: a top view of mean and variance, learnt while it is seen."""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.masks.colour_model import UNIFORM, feature_step
from egophys_core.perception.stages import View

_CELLS = 512
_MEMORY = 60
"""Frames after which the mean forgets: light that changes slowly is followed."""
_LIGHT_RANGE = float(np.log(4.0))
_SHADOW_SHARE = 0.15
_BRIGHTER_SHARE = 0.02
_FIRST_VARIANCE = 0.005
"""Of features, before a cell has been seen a few times."""
_LEAST_VARIANCE = np.array([0.025, 0.025, 0.03], np.float32) ** 2
_FILL_SIGMAS = (12.0, 60.0, 200.0)
"""Cells over which the table is averaged for a place never seen: the nearest that reach it count."""


def has_pose(view: View) -> bool:
    """Whether the pose of a view is known."""
    return bool(np.isfinite(view.world_from_camera).all())


def table_homography(view: View, table_height: float = 0.0) -> np.ndarray:
    """[3, 3] float64: homogeneous pixels of a view with pose from (x, y, 1) in metres on the table.

    The third component of the product is the depth, positive in front of the camera.
    """
    camera_from_world = np.linalg.inv(view.world_from_camera)
    rotation, origin = camera_from_world[:3, :3], camera_from_world[:3, 3]
    plane = np.column_stack([rotation[:, 0], rotation[:, 1], rotation[:, 2] * table_height + origin])
    return np.asarray(view.camera_matrix @ plane)


def table_places(view: View, pixels: np.ndarray, table_height: float = 0.0) -> np.ndarray:
    """[N, 2] x and y, metres, where the rays of pixels [N, 2] meet the table; NaN where they do not."""
    inverse = np.linalg.inv(table_homography(view, table_height))
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ inverse.T
    with np.errstate(divide="ignore", invalid="ignore"):
        places = rays[:, :2] / rays[:, 2:]
    places[rays[:, 2] <= 0] = np.nan
    return places


@dataclass(frozen=True, kw_only=True)
class ExpectedTable:
    """The table as a view would show it, were nothing on it."""

    mean: np.ndarray
    """[S, S, 3] float32 of `log_features`."""
    variance: np.ndarray
    """[S, S, 3] float32, of the features."""
    inside: np.ndarray
    """[S, S] bool: pixels in the grid; elsewhere the others mean nothing."""
    seen: np.ndarray
    """[S, S] bool: of those, pixels whose cell has been seen free; others are guessed from around them."""


class TableBackground:
    """Mean and variance of the table's colour on a grid of the table plane, around a centre.

    Cells never seen free take the colour of the table around them, with the variance of its texture.
    """

    def __init__(
        self, view: View, centre: np.ndarray, features: np.ndarray, is_table: np.ndarray, *, table_height: float = 0.0
    ) -> None:
        """Learn the table from a first view.

        Args:
            view: a view with pose; a cell is as large as its pixels at the centre.
            centre: [2] x and y, metres, on the table.
            features: [S, S, 3] float32 of `log_features`, of the smoothed image.
            is_table: [S, S] bool.
            table_height: z of the table, metres.
        """
        self._height = table_height
        homography = table_homography(view, table_height)
        around = np.array([[0, 0], [1e-3, 0], [0, 1e-3]]) + centre
        pixels = np.column_stack([around, np.ones(3)]) @ homography.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        cell = 1e-3 / np.sqrt(abs(np.linalg.det(pixels[1:] - pixels[0])))
        corner = centre - cell * _CELLS / 2
        self._table_from_cell = np.array([[cell, 0, corner[0]], [0, cell, corner[1]], [0, 0, 1]])
        self._mean = np.zeros((_CELLS, _CELLS, 3), np.float32)
        self._variance = np.zeros((_CELLS, _CELLS, 3), np.float32)
        self._count = np.zeros((_CELLS, _CELLS), np.float32)
        self._typical = np.full(3, _FIRST_VARIANCE, np.float32)
        self.learn(view, features, is_table, np.zeros_like(is_table))
        self._fill()

    def learn(self, view: View, features: np.ndarray, is_table: np.ndarray, is_changed: np.ndarray) -> None:
        """Add the pixels of a view that show the table.

        Args:
            view: the view, with pose.
            features: [S, S, 3] float32 of `log_features`, of the smoothed image, gain removed.
            is_table: [S, S] bool.
            is_changed: [S, S] bool: where the light changed for good, so that what was learnt is forgotten.
        """
        to_view = table_homography(view, self._height) @ self._table_from_cell
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = (_CELLS, _CELLS)
        either = np.dstack([is_table, is_changed]).astype(np.uint8) * 255
        seen, changed = np.moveaxis(cv2.warpPerspective(either, to_view, size, flags=flags), -1, 0)
        cells = (seen > 254) & _in_front(to_view, size)
        values = cv2.warpPerspective(features, to_view, size, flags=flags)[cells]
        count = np.where(changed[cells] > 127, 1, np.minimum(self._count[cells] + 1, _MEMORY))[:, None]
        before, variance = self._mean[cells], self._variance[cells]
        change = values - before
        mean = before + change / count
        self._variance[cells] = variance + (change * (values - mean) - variance) / count
        self._mean[cells] = mean
        self._count[cells] = count[:, 0]
        settled = self._count > 5
        if settled.any():
            self._typical = np.median(self._variance[settled][::16], axis=0)

    def expected(self, view: View) -> "ExpectedTable":
        """What a view with pose shows of the table, were nothing on it."""
        size = (view.image.shape[1], view.image.shape[0])
        from_view = np.linalg.inv(table_homography(view, self._height) @ self._table_from_cell)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        inside = np.where(self._count > 0, np.uint8(255), np.uint8(1))
        inside = cv2.warpPerspective(inside, from_view, size, flags=flags)
        inside[~_in_front(from_view, size)] = 0
        # A cell seen a few times has the variance of a typical cell as much as its own.
        weight = 1 / (self._count + 5)
        weight[self._count == 0] = 0
        own = self._variance * (1 - 5 * weight)[..., None]
        variance = own + (5 * weight)[..., None] * self._typical
        mean = cv2.warpPerspective(self._mean, from_view, size, flags=flags)
        variance = cv2.warpPerspective(variance, from_view, size, flags=flags) + _LEAST_VARIANCE
        return ExpectedTable(mean=mean, variance=variance, inside=inside > 0, seen=inside > 127)

    def _fill(self) -> None:
        """Give cells never seen the mean and variance of the table around them."""
        seen = self._count > 0
        if not seen.any():
            return
        middle = np.median(self._mean[seen], axis=0)
        off = np.abs(self._mean - middle)
        # Boards and other things on the table are no guide to what is under the object.
        like = seen & (off < 6 * np.median(off[seen], axis=0) + 0.05).all(axis=-1)
        total, weight = np.zeros((_CELLS, _CELLS, 6), np.float32), np.zeros((_CELLS, _CELLS), np.float32)
        values = np.dstack([self._mean, self._mean**2]) * like[..., None]
        for sigma in _FILL_SIGMAS:
            small = (_CELLS // 4, _CELLS // 4)
            reduced = cv2.resize(np.dstack([values, like]).astype(np.float32), small, interpolation=cv2.INTER_AREA)
            wide = cv2.resize(cv2.GaussianBlur(reduced, (0, 0), sigma / 4), (_CELLS, _CELLS))
            total += wide[..., :6] * (1e-3 ** _FILL_SIGMAS.index(sigma))
            weight += wide[..., 6] * (1e-3 ** _FILL_SIGMAS.index(sigma))
        fill = total / np.maximum(weight, 1e-12)[..., None]
        fill[weight < 1e-12, :3] = middle
        self._mean[~seen] = fill[~seen, :3]
        self._variance[~seen] = np.maximum(fill[~seen, 3:] - fill[~seen, :3] ** 2, 0) + _FIRST_VARIANCE / 4


def _in_front(homography: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """[H, W] bool: pixels that the homography leaves in front of the camera (positive third component)."""
    x, y = np.arange(size[0]), np.arange(size[1])[:, None]
    return homography[2, 0] * x + homography[2, 1] * y + homography[2, 2] > 0


def table_log_likelihood(features: np.ndarray, mean: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log-likelihoods, per bin of a `ColourModel`, of table in the light it was learnt in and in another.

    In the same light a pixel has the features expected, within their variance. In another, a shadow or where a shadow
    was, it has their chromaticity and any brightness within a factor of four, darker being likelier.

    Args:
        features: [S, S, 3] float32 of `log_features`.
        mean: [S, S, 3] float32, expected.
        variance: [S, S, 3] float32, of the features expected.

    Returns:
        [S, S] float32 each.
    """
    step = feature_step()
    off = features - mean
    scaled = cv2.multiply(off, off) / variance + cv2.log(variance)
    chroma = -0.5 * (scaled[..., 0] + scaled[..., 1]) + np.float32(np.log(step[0] * step[1] / (2 * np.pi)))
    same = chroma - 0.5 * scaled[..., 2] + np.float32(np.log(step[2] / np.sqrt(2 * np.pi)))
    per_bin = step[2] / _LIGHT_RANGE
    in_range = np.abs(off[..., 2]) < _LIGHT_RANGE
    share = np.where(off[..., 2] < 0, np.float32(_SHADOW_SHARE), np.float32(_BRIGHTER_SHARE)) * per_bin
    other = np.where(in_range, chroma + cv2.log(share), np.float32(-20))
    return np.maximum(same, UNIFORM - 8), np.maximum(other, UNIFORM - 8)
