"""A frame compared with a keyframe: which points of it are where, and which of those lie on one plane."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from egophys_core.perception.surface.patch_match import LOST_PX, match

FEWEST_POINTS = 30
"""Points on the plane that a frame needs."""
LEAST_SHARE = 0.25
"""Of the keyframe's points in the image; fewer do not make the plane dominant."""
OFF_PLANE_PX = 1.0
"""Pixels: points farther from where the homography has them are not on the plane."""

_CELLS = 20
"""Along a side of the image, one point each."""
_LEAST_CORNER = 2.5e-4
"""Of `cv2.cornerMinEigenVal` with blocks of 7: below it is what noise of 5 grey levels has."""
_MARGIN = 10
_NEW_BELOW = 0.6
"""Share of a keyframe's points in the image below which another keyframe is looked for."""
_LARGEST_ZOOM = 1.6
_LEAST_SCALE = 1e-3


@dataclass(kw_only=True)
class Keyframe:
    """A frame that others are compared with."""

    frame: int
    points: np.ndarray
    """[N, 2] float32 pixels."""
    from_first: np.ndarray
    """[3, 3] homography: its pixels from those of the first keyframe; drifts with the chain, a start only."""
    tracked: np.ndarray
    """[N] int: frames in which the point was found."""
    on_plane: np.ndarray
    """[N] int: of those, frames in which it was on the plane."""
    best_share: float = 0.0
    """Largest share, in any frame, that was found on the plane of the points that were in the image."""
    grey: np.ndarray = field(repr=False)
    """[H, W] uint8, of even contrast."""
    features: tuple[np.ndarray, np.ndarray] | None = field(default=None, repr=False)
    """[M, 2] float32 pixels and [M, 128] float32 descriptors of its SIFT features, once they were needed."""


@dataclass(frozen=True, kw_only=True)
class PlaneFit:
    """Where a frame shows the plane that a keyframe shows."""

    homography: np.ndarray
    """[3, 3] pixels of the frame from those of the keyframe."""
    tracked: np.ndarray
    """[M] int: the keyframe's points that were found."""
    points: np.ndarray
    """[N] int16: of those, the ones on the plane."""
    pixels: np.ndarray
    """[N, 2] float32: where these are in the frame."""
    share: float
    """Of the keyframe's points in the image, those found on the plane."""


def apply_homography(homography: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """[N, 2] float64: where a homography [3, 3] takes pixels [N, 2]."""
    moved = pixels @ homography[:, :2].T + homography[:, 2]
    return np.asarray(moved[:, :2] / moved[:, 2:])


def spread_corners(image: np.ndarray) -> np.ndarray:
    """[N, 2] float32: the best corner of each cell of an image that is better than noise."""
    corner = cv2.cornerMinEigenVal(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), 7, ksize=3)
    for edge in (corner[:_MARGIN], corner[-_MARGIN:], corner[:, :_MARGIN], corner[:, -_MARGIN:]):
        edge[:] = 0
    cell = max(8, max(corner.shape) // _CELLS)
    rows, columns = corner.shape[0] // cell, corner.shape[1] // cell
    cells = corner[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell).swapaxes(1, 2)
    cells = cells.reshape(rows, columns, cell * cell)
    best = cells.argmax(axis=-1)
    y, x = np.mgrid[:rows, :columns] * cell + np.stack([best // cell, best % cell])
    good = cells.max(axis=-1) > _LEAST_CORNER
    return np.column_stack([x[good], y[good]]).astype(np.float32)


def fit_plane(key: Keyframe, grey: np.ndarray, guess: np.ndarray, levels: int) -> PlaneFit | None:
    """The homography to a frame and the points that fit it, from a guess; None if they are too few."""
    inside = np.flatnonzero(_is_inside(key.points, guess, grey.shape))
    if len(inside) < FEWEST_POINTS:
        return None
    # Seen as the keyframe saw it, a patch has only moved: what is left to find is not biased by the slant.
    size = (key.grey.shape[1], key.grey.shape[0])
    seen = cv2.warpPerspective(grey, guess, size, flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    matches = match(key.grey, seen, key.points[inside], levels=levels)
    kept = matches.returned < LOST_PX
    tracked = inside[kept]
    if len(tracked) < FEWEST_POINTS:
        return None
    pixels = apply_homography(guess, matches.pixels[kept])
    homography, on_plane = plane_homography(key.points[tracked], pixels, OFF_PLANE_PX)
    if homography is None or on_plane.sum() < max(FEWEST_POINTS, LEAST_SHARE * len(inside)):
        return None
    return PlaneFit(
        homography=homography,
        tracked=tracked,
        points=tracked[on_plane].astype(np.int16),
        pixels=pixels[on_plane].astype(np.float32),
        share=float(on_plane.sum() / len(inside)),
    )


def is_near(key: Keyframe, fit: PlaneFit, shape: tuple[int, ...]) -> bool:
    """Whether a frame sees enough of a keyframe, about as large, and finds in it as much as others do."""
    middle = key.points.mean(axis=0)
    homography = fit.homography
    zoom = np.sqrt(np.linalg.det(homography) / (homography[2, :2] @ middle + homography[2, 2]) ** 3)
    inside = share_inside(key.points, homography, shape)
    is_alike = 1 / _LARGEST_ZOOM < zoom < _LARGEST_ZOOM and fit.share >= _NEW_BELOW * key.best_share
    return bool(inside >= _NEW_BELOW and is_alike)


def plane_homography(source: np.ndarray, target: np.ndarray, threshold: float) -> tuple[np.ndarray | None, np.ndarray]:
    """The homography [3, 3] of determinant 1 between most of [N, 2] pixels, and for which [N] bool it holds.

    None if there is none that keeps the points in front of the camera and shows the same side of the plane.
    """
    homography, fits = cv2.findHomography(source, target, cv2.USAC_MAGSAC, threshold)
    if homography is None or not np.isfinite(homography).all():
        return None, np.zeros(len(source), bool)
    held = fits[:, 0] > 0
    scale = np.cbrt(np.linalg.det(homography))
    if abs(scale) < _LEAST_SCALE or not held.any():
        return None, held
    homography = homography / scale
    depth = source[held] @ homography[2, :2] + homography[2, 2]
    return (homography, held) if (depth > 0).all() else (None, held)


def _is_inside(points: np.ndarray, homography: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    moved = apply_homography(homography, points)
    in_front = points @ homography[2, :2] + homography[2, 2] > 0
    largest = np.array(shape[1::-1]) - _MARGIN
    return np.asarray((moved > _MARGIN).all(axis=1) & (moved < largest).all(axis=1) & in_front)


def share_inside(points: np.ndarray, homography: np.ndarray, shape: tuple[int, ...]) -> float:
    """Share of points [N, 2] that a homography takes into an image of this shape."""
    return float(_is_inside(points, homography, shape).mean())
