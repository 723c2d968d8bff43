"""Errors of masks as DAVIS defines them: region similarity J and contour accuracy F.

Perazzi et al., "A Benchmark Dataset and Evaluation Methodology for Video Object Segmentation", CVPR 2016,
with the conventions of its evaluation code. The mean here is over all frames given; the DAVIS challenge leaves out the
first, whose mask it gives, and the last: to compare with its tables pass the frames between.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError

BOUNDARY_TOLERANCE = 0.008
"""Share of the image diagonal, rounded up to whole pixels: contours at most this far apart agree."""


@dataclass(frozen=True, kw_only=True)
class MaskScores:
    """Agreement of the masks of one video with the true ones."""

    region_per_frame: np.ndarray
    """[T] in 0..1: J."""
    contour_per_frame: np.ndarray
    """[T] in 0..1: F."""

    @property
    def region(self) -> float:
        """J of the video: mean over the frames; NaN without any."""
        return float(self.region_per_frame.mean()) if len(self.region_per_frame) else float("nan")

    @property
    def contour(self) -> float:
        """F of the video: mean over the frames; NaN without any."""
        return float(self.contour_per_frame.mean()) if len(self.contour_per_frame) else float("nan")


def mask_scores(predicted: Iterable[np.ndarray], truth: Iterable[np.ndarray]) -> MaskScores:
    """J and F of each frame; frames are taken one by one, so a long video need not be in memory.

    Args:
        predicted: T masks [H, W] bool.
        truth: T masks [H, W] bool.

    Raises:
        EpisodeError: the two do not have the same number or size of frames, or are not bool.
    """
    region, contour = [], []
    for frame, (one, other) in enumerate(zip_longest(predicted, truth)):
        if one is None or other is None:
            which = "predicted" if one is None else "true"
            raise EpisodeError(f"the {which} masks end before frame {frame}, the others go on; pair them by stamp")
        region.append(region_similarity(one, other))
        contour.append(contour_accuracy(one, other))
    return MaskScores(region_per_frame=np.array(region), contour_per_frame=np.array(contour))


def region_similarity(predicted: np.ndarray, truth: np.ndarray) -> float:
    """J in 0..1: pixels in both masks [H, W] bool over pixels in either; 1 if both are empty."""
    _check(predicted, truth)
    either = np.count_nonzero(predicted | truth)
    return np.count_nonzero(predicted & truth) / either if either else 1.0


def contour_accuracy(predicted: np.ndarray, truth: np.ndarray) -> float:
    """F in 0..1 of two masks [H, W] bool: harmonic mean of the precision and the recall of the contour.

    Precision is the share of the predicted contour that has true contour within the tolerance, recall the reverse.
    1 if neither mask has a contour (both empty, or both full), 0 if only one has.
    """
    _check(predicted, truth)
    one, other = np.argwhere(contour(predicted)), np.argwhere(contour(truth))
    if len(one) == 0 or len(other) == 0:
        return float(len(one) == len(other))
    tolerance = np.ceil(BOUNDARY_TOLERANCE * np.linalg.norm(truth.shape))
    # DAVIS dilates the other contour by a disc; a pixel is in that if the nearest contour pixel is within the radius.
    precision = np.mean(cKDTree(other).query(one)[0] <= tolerance)
    recall = np.mean(cKDTree(one).query(other)[0] <= tolerance)
    return float(2 * precision * recall / (precision + recall)) if precision + recall > 0 else 0.0


def contour(mask: np.ndarray) -> np.ndarray:
    """[H, W] bool: pixels of a mask [H, W] that differ from the one to the right, below or diagonally below.

    One pixel wide and half a pixel to the upper left of the edge. The border of the image is no contour.
    """
    padded = np.pad(mask, ((0, 1), (0, 1)), mode="edge")
    return (mask != padded[:-1, 1:]) | (mask != padded[1:, :-1]) | (mask != padded[1:, 1:])


def _check(predicted: np.ndarray, truth: np.ndarray) -> None:
    if truth.ndim != 2 or predicted.shape != truth.shape:
        raise EpisodeError(
            f"masks must be [H, W] and of one size, got predicted {predicted.shape} and true {truth.shape}; "
            "resize the true mask with nearest-neighbour sampling"
        )
    if predicted.dtype != bool or truth.dtype != bool:
        raise EpisodeError(
            f"masks must be bool, got predicted {predicted.dtype} and true {truth.dtype}; compare them, as in mask > 0"
        )
