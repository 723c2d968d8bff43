"""Refine a region of an image to the edges of what it shows, by GrabCut (Rother et al., SIGGRAPH 2004)."""

import cv2
import numpy as np
from scipy import ndimage

_LARGEST_SIDE = 220
"""Pixels to which the part of the image around the region is reduced before it is cut."""


def cut_region(
    image: np.ndarray,
    region: np.ndarray,
    *,
    outside: bool = False,
    sure: np.ndarray | None = None,
    background: np.ndarray | None = None,
) -> np.ndarray:
    """Refine a region by GrabCut; [S, S] bool, the largest part and what is nearly as large.

    Args:
        image: [S, S, 3] uint8 BGR.
        region: [S, S] bool; with `outside` the object is somewhere in it, else it is nearly it.
        outside: whether all that is not in the region is surely no object.
        sure: [S, S] bool, pixels that are surely object.
        background: [S, S] bool, pixels that are surely none, but for a rim of the region.
    """
    side = image.shape[0]
    x0, y0, x1, y1 = box_of(region)
    margin = max(8, int(0.3 * max(x1 - x0, y1 - y0)))
    x0, y0, x1, y1 = max(0, x0 - margin), max(0, y0 - margin), min(side, x1 + margin), min(side, y1 + margin)
    scale = min(1.0, _LARGEST_SIDE / max(x1 - x0, y1 - y0))
    size = (max(2, round((x1 - x0) * scale)), max(2, round((y1 - y0) * scale)))
    crop = cv2.resize(image[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)

    def reduced(mask: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.resize(mask[y0:y1, x0:x1].astype(np.uint8), size, interpolation=cv2.INTER_NEAREST))

    small = reduced(region)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9))
    if outside:
        labels = np.where(small > 0, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    else:
        labels = np.full(small.shape, cv2.GC_PR_BGD, np.uint8)
        labels[small > 0] = cv2.GC_PR_FGD
        labels[cv2.erode(small, kernel, iterations=1) > 0] = cv2.GC_FGD
        labels[cv2.dilate(small, kernel, iterations=2) == 0] = cv2.GC_BGD
    if background is not None:
        rim = cv2.dilate(small, np.ones((5, 5), np.uint8)) > 0
        labels[(reduced(background) > 0) & ~rim] = cv2.GC_BGD
    if sure is not None:
        labels[reduced(sure) > 0] = cv2.GC_FGD
    if not ((labels % 2 == 0).any() and (labels % 2 == 1).any()):
        return region
    cv2.setRNGSeed(0)
    cv2.grabCut(crop, labels, None, np.zeros((1, 65)), np.zeros((1, 65)), 4, cv2.GC_INIT_WITH_MASK)
    found = (labels % 2 == 1).astype(np.float32)
    mask = np.zeros((side, side), bool)
    mask[y0:y1, x0:x1] = cv2.resize(found, (x1 - x0, y1 - y0), interpolation=cv2.INTER_LINEAR) > 0.5
    return main_parts(np.asarray(ndimage.binary_fill_holes(mask)))


def main_parts(mask: np.ndarray) -> np.ndarray:
    """The largest connected part of a mask and those at least a tenth as large."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count < 3:
        return mask
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    return np.asarray(np.isin(labels, np.flatnonzero(areas >= 0.1 * areas.max())))


def box_of(mask: np.ndarray) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1 in pixels around a mask [H, W] bool, the last two exclusive; zeros if it is empty."""
    if not mask.any():
        return (0, 0, 0, 0)
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return (x, y, x + width, y + height)
