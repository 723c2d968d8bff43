"""Where small patches of one image are found in another: pyramidal Lucas-Kanade, forward and backward."""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.local_contrast import local_contrast

WINDOW = 15
"""Pixels: side of a patch."""

LEVELS = 2
"""Times the image is halved: displacements of up to about 7 * 2^2 pixels are found."""

LOST_PX = 0.5
"""Pixels: a patch that comes back farther from its start is taken for lost."""

CONTRAST_SIGMA = 6.0
"""Pixels: neighbourhood over which brightness and contrast are made alike."""

FEWEST_GREYS = 3.0
"""Grey levels of standard deviation below which a neighbourhood is noise, which is not amplified."""


@dataclass(frozen=True, kw_only=True)
class Matches:
    """Where N patches were found."""

    pixels: np.ndarray
    """[N, 2] float32, x and y."""
    returned: np.ndarray
    """[N] float32, pixels: how far from its start a patch ends that is searched there and back; inf if lost."""


def even_contrast(image: np.ndarray) -> np.ndarray:
    """[H, W] uint8 of a BGR image: less its local mean, over its local deviation; shading and exposure drop out."""
    apart, deviation = local_contrast(image, CONTRAST_SIGMA)
    return np.clip(128 + 48 * apart / (deviation + FEWEST_GREYS), 0, 255).astype(np.uint8)


def match(
    source: np.ndarray, target: np.ndarray, places: np.ndarray, guess: np.ndarray | None = None, levels: int = LEVELS
) -> Matches:
    """Find patches of one image in another.

    Args:
        source: [H, W] uint8.
        target: [H, W] uint8.
        places: [N, 2], x and y of the patches' centres in the source.
        guess: [N, 2], where to start in the target; the same places if None.
        levels: of the pyramid.
    """
    if len(places) == 0:
        return Matches(pixels=np.zeros((0, 2), np.float32), returned=np.zeros(0, np.float32))
    start = np.ascontiguousarray(places, np.float32)
    first = np.ascontiguousarray(start if guess is None else guess, np.float32)
    found, forward = _search(source, target, start, first.copy(), levels)
    back, backward = _search(target, source, found, start + found - first, levels)
    returned = np.linalg.norm(back - start, axis=1)
    returned[~(forward & backward)] = np.inf
    return Matches(pixels=found, returned=returned)


def _search(
    source: np.ndarray, target: np.ndarray, places: np.ndarray, guess: np.ndarray, levels: int
) -> tuple[np.ndarray, np.ndarray]:
    """[N, 2] places found, and [N] bool where the search came to an end."""
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        source,
        target,
        places,
        guess,
        winSize=(WINDOW, WINDOW),
        maxLevel=levels,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01),
    )
    return found, status[:, 0] > 0


def likeness(
    source: np.ndarray, places: np.ndarray, target: np.ndarray, found: np.ndarray, radius: int = 5
) -> np.ndarray:
    """[N] in -1..1: normalised cross-correlation of patches around [N, 2] in the source and [N, 2] in the target."""
    steps = np.arange(-radius, radius + 1, dtype=np.float32)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, -1, 2)

    def patches(image: np.ndarray, centres: np.ndarray) -> np.ndarray:
        at = centres[:, None].astype(np.float32) + grid
        values = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(np.float32)
        values -= values.mean(axis=1, keepdims=True)
        return values / (np.linalg.norm(values, axis=1, keepdims=True) + 1e-3)

    if len(places) == 0:
        return np.zeros(0)
    return (patches(source, places) * patches(target, found)).sum(axis=1)
