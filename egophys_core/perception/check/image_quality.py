"""How sharp, how bright and how textured views are."""

from collections.abc import Sequence

import cv2
import numpy as np

from egophys_core.perception.masks.table_background import has_pose, table_homography
from egophys_core.perception.stages import View

PATCH = 15
"""Pixels: side of the patch that a tracked place is known by."""
TRACKABLE_PX = 0.15
"""Pixels: a patch whose place noise leaves this uncertain, or less, can be followed."""

_SMOOTHING, _REBLUR = 0.7, 1.2
"""Pixels."""
_LEAST_RATIO, _SOFTEST = 1.01, 10.0
"""Below this ratio of slopes an image is softer than can be told, so many pixels."""
_EDGES = 0.02
"""Share of the pixels, those of the steepest edges, that sharpness is measured at."""
_SAMPLES = 600
"""Places on the table whose brightness is compared."""


def blur_px(image: np.ndarray) -> float:
    """Pixels: standard deviation of the blur at the steepest edges of an image [H, W, 3].

    A step blurred by s has a slope of 1 / s, and of 1 / sqrt(s^2 + r^2) when blurred by r once more (Zhuo and Sim,
    Defocus map estimation from a single image, 2011).
    """
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    # Noise has little slope left after this; it is taken off again in squares.
    gray = cv2.GaussianBlur(gray, (0, 0), _SMOOTHING)
    again = cv2.GaussianBlur(gray, (0, 0), _REBLUR)
    # Motion blurs in one direction alone: the softer of both counts.
    return max(_softness(gray, again, axis) for axis in ((1, 0), (0, 1)))


def _softness(gray: np.ndarray, again: np.ndarray, axis: tuple[int, int]) -> float:
    slope, softer = (np.abs(cv2.Sobel(each, cv2.CV_32F, *axis, ksize=3)) for each in (gray, again))
    # Beside an edge's crest the ratio means nothing.
    crest = slope >= cv2.dilate(slope, np.ones((1, 3) if axis[0] else (3, 1), np.uint8))
    steep = crest & (slope >= np.quantile(slope, 1 - _EDGES))
    ratio = float(np.median(slope[steep] / np.maximum(softer[steep], 1e-3)))
    if ratio <= _LEAST_RATIO:
        return _SOFTEST
    # A difference over two pixels is itself as soft as a box of that width.
    own = _SMOOTHING**2 + 2**2 / 12
    return min(float(np.sqrt(max(_REBLUR**2 / (ratio**2 - 1) - own, 0.0))), _SOFTEST)


def noise_level(image: np.ndarray) -> float:
    """Grey levels: standard deviation of the noise (Immerkaer, Fast noise variance estimation, 1996), its median."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    filtered = np.abs(cv2.filter2D(gray, -1, kernel))
    return max(float(np.median(filtered)) / 0.6745 / 6, 0.5)


def trackable(image: np.ndarray) -> np.ndarray:
    """[H, W] bool: pixels whose patch can be followed.

    The place of a patch in noise of deviation n is known to n / sqrt(l), with l the smaller eigenvalue of the sum of
    its gradients' products (Foerstner).
    """
    gray = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32), (0, 0), _SMOOTHING)
    x, y = (cv2.Sobel(gray, cv2.CV_32F, *each, ksize=3) / 8 for each in ((1, 0), (0, 1)))
    xx, yy, xy = (cv2.boxFilter(each, -1, (PATCH, PATCH), normalize=False) for each in (x * x, y * y, x * y))
    smaller = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    # Noise has gradients, too: of white noise after that smoothing and Sobel's, about a sixteenth of its variance.
    noise = noise_level(image)
    smaller = smaller - PATCH**2 * noise**2 / 16
    return np.asarray(smaller > (noise / TRACKABLE_PX) ** 2)


def light_of(views: Sequence[View], covered: Sequence[np.ndarray]) -> np.ndarray:
    """[V] brightness of the table relative to the first view; of the whole image where there are no poses.

    Args:
        views: the first sees the object at rest.
        covered: [S, S] bool of each view: pixels that show no table; none if that is not known.
    """
    grays = [cv2.cvtColor(view.image, cv2.COLOR_BGR2GRAY).astype(np.float32) + 1 for view in views]
    if not has_pose(views[0]):
        return np.array([np.median(gray) / np.median(grays[0]) for gray in grays])
    side = grays[0].shape[0]
    free = np.ones((side, side), bool)
    if covered:
        free = cv2.dilate(covered[0].astype(np.uint8), np.ones((15, 15), np.uint8)) == 0
    rows, columns = np.nonzero(free)
    chosen = np.random.default_rng(0).permutation(len(rows))[:_SAMPLES]
    pixels = np.column_stack([columns[chosen], rows[chosen]]).astype(float)
    first, light = np.linalg.inv(table_homography(views[0])), []
    smooth = [cv2.GaussianBlur(gray, (0, 0), 3) for gray in grays]
    before = smooth[0][rows[chosen], columns[chosen]]
    for index, view in enumerate(views):
        moved = cv2.perspectiveTransform(pixels[None], table_homography(view) @ first)[0].round().astype(int)
        inside = ((moved >= 0) & (moved < side)).all(axis=1)
        x, y = moved[inside].T
        ratio = np.log(smooth[index][y, x] / before[inside])
        if covered:
            ratio = ratio[~covered[index][y, x]]
        light.append(float(np.exp(np.median(ratio))) if len(ratio) > 20 else np.nan)
    return np.array(light)
