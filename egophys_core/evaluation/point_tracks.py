"""Errors of tracks in the image as TAP-Vid defines them: delta_avg, occlusion accuracy, average Jaccard.

Doersch et al., "TAP-Vid: A Benchmark for Tracking Any Point in a Video", NeurIPS 2022, with the conventions of its
evaluation code, queries "first":

- Pixels are those of the image stretched to 256 x 256: x is multiplied by 256 / width, y by 256 / height. So on a
  square crop of 518 pixels the thresholds 1 .. 16 are 2.02 .. 32.4 pixels of the crop.
- A track is given where it is first visible and judged in all frames after that one, visible there or not.
- All (frame, track) pairs of a video count alike. The score of several videos is the mean of theirs.
- "Within" a threshold means less than it. A position that is not finite is within none.
"""

from dataclasses import dataclass

import numpy as np

from egophys_core.errors import EpisodeError

THRESHOLDS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Pixels of a 256 x 256 image."""

SIDE = 256.0
"""Pixels: width and height that images are scaled to before thresholds apply."""


@dataclass(frozen=True, kw_only=True)
class PointTrackScores:
    """Agreement of the tracks of one video with the true ones, 0..1; NaN where a share is of nothing."""

    within: np.ndarray
    """[5]: share of the truly visible pairs whose position is within each threshold, said to be visible or not."""
    jaccard: np.ndarray
    """[5]: for each threshold, true positives over truly visible pairs and false positives.

    True positive: visible, said to be, and within. False positive: said to be visible, but hidden or not within. A
    visible pair that is said to be visible elsewhere thus counts twice below the line, as in the paper.
    """
    occlusion_accuracy: float
    """OA: share of the pairs whose visibility is said rightly."""

    @property
    def delta_avg(self) -> float:
        """Mean of `within` over the thresholds."""
        return float(self.within.mean())

    @property
    def average_jaccard(self) -> float:
        """AJ: mean of `jaccard` over the thresholds."""
        return float(self.jaccard.mean())


def point_track_scores(
    predicted: np.ndarray,
    predicted_visible: np.ndarray,
    truth: np.ndarray,
    visible: np.ndarray,
    image_size: tuple[int, int],
) -> PointTrackScores:
    """Compare tracks with the true ones of the same queries.

    Args:
        predicted: [T, N, 2] pixels x, y of the image.
        predicted_visible: [T, N] bool.
        truth: [T, N, 2] pixels x, y, finite where visible.
        visible: [T, N] bool.
        image_size: width and height of the image, pixels.

    Raises:
        EpisodeError: shapes do not fit, visibility is not bool, or a visible track has no position.
    """
    _check(predicted, predicted_visible, truth, visible, image_size)
    judged = frames_after_query(visible)
    scale = SIDE / np.array(image_size, float)
    placed = np.isfinite(predicted).all(axis=2) & visible
    # Infinite also where hidden: there no position is right.
    distance = np.full(visible.shape, np.inf)
    distance[placed] = np.linalg.norm((predicted[placed] - truth[placed]) * scale, axis=1)

    shown = judged & visible
    said = judged & predicted_visible
    within, jaccard = [], []
    for threshold in THRESHOLDS:
        close = distance < threshold
        within.append(_share(shown & close, np.count_nonzero(shown)))
        false = np.count_nonzero(said & ~close)
        jaccard.append(_share(shown & said & close, np.count_nonzero(shown) + false))
    right = judged & (predicted_visible == visible)
    return PointTrackScores(
        within=np.array(within),
        jaccard=np.array(jaccard),
        occlusion_accuracy=_share(right, np.count_nonzero(judged)),
    )


def first_visible(visible: np.ndarray) -> np.ndarray:
    """[N] int: the frame in which each track of [T, N] bool is first visible, its query; T if it never is."""
    return np.where(visible.any(axis=0), visible.argmax(axis=0), len(visible))


def frames_after_query(visible: np.ndarray) -> np.ndarray:
    """[T, N] bool: frames after the one in which a track of [T, N] bool is first visible."""
    return np.arange(len(visible))[:, None] > first_visible(visible)


def _share(chosen: np.ndarray, total: int) -> float:
    return np.count_nonzero(chosen) / total if total else float("nan")


def _check(
    predicted: np.ndarray,
    predicted_visible: np.ndarray,
    truth: np.ndarray,
    visible: np.ndarray,
    image_size: tuple[int, int],
) -> None:
    if truth.ndim != 3 or truth.shape[2] != 2 or predicted.shape != truth.shape:
        raise EpisodeError(
            f"tracks must be [T, N, 2] in pixels, predicted and true alike, got {predicted.shape} and {truth.shape}"
        )
    for name, flags in (("predicted", predicted_visible), ("true", visible)):
        if flags.shape != truth.shape[:2] or flags.dtype != bool:
            raise EpisodeError(
                f"{name} visibility must be {truth.shape[:2]} bool (not occlusion, not a probability), "
                f"got {flags.shape} {flags.dtype}"
            )
    lost = visible & ~np.isfinite(truth).all(axis=2)
    if lost.any():
        frame, track = np.argwhere(lost)[0]
        raise EpisodeError(f"true track {track} is visible in frame {frame} but has no position; mark it as hidden")
    if min(image_size) < 1:
        raise EpisodeError(f"image size must be width and height in pixels, got {image_size}")
