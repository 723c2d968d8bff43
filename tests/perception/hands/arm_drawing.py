"""Drawn masks of arms: a bar from a place to a round hand at its end."""

from collections.abc import Sequence

import cv2
import numpy as np

SIDE = 320

Place = tuple[int, int]


def arm_mask(start: Place, end: Place, *, radius: int = 26, half_width: int = 18) -> np.ndarray:
    """[SIDE, SIDE] bool: an arm from `start` whose hand, a disc of `radius`, has its middle at `end`, both x, y."""
    mask = np.zeros((SIDE, SIDE), np.uint8)
    cv2.line(mask, start, end, 1, 2 * half_width)
    cv2.circle(mask, end, radius, 1, -1)
    return mask > 0


def disc(middle: Place, radius: int) -> np.ndarray:
    """[SIDE, SIDE] bool."""
    return together([cv2.circle(np.zeros((SIDE, SIDE), np.uint8), middle, radius, 1, -1) > 0])


def together(masks: Sequence[np.ndarray]) -> np.ndarray:
    """[SIDE, SIDE] bool: what is in any of them."""
    return np.logical_or.reduce([np.zeros((SIDE, SIDE), bool), *masks])
