"""Which tracked points are believed and which become controllers (the paper, Appendix B.1)."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError
from egophys_core.perception.stages import Masks, Tracks

GROUND_MARGIN_M = 0.005
"""How far the ground is below the lowest point of the object, metres (Appendix B.1)."""
FEWEST_NEIGHBOURS = 3
"""With fewer neighbours to compare with, nothing is said of a point's motion."""


@dataclass(frozen=True, kw_only=True)
class MaskHits:
    """Which tracks lie in which mask."""

    object: np.ndarray
    """[T, N] bool: visible and in the mask of the object."""
    hand: np.ndarray
    """[T, N] bool: visible and in the mask of the hand."""


def mask_hits(tracks: Tracks, masks: Iterable[Masks], *, margin: int = 1) -> MaskHits:
    """Where each visible track lies in the masks of its view; the masks are taken one by one and not kept.

    Args:
        tracks: T views, N tracks.
        masks: T pairs of masks [S, S].
        margin: pixels that a track may be outside of a mask; masks and tracks are no more exact than that.

    Raises:
        EpisodeError: not one pair of masks for each view.
    """
    views, count = tracks.visible.shape
    on_object, on_hand = np.zeros((views, count), bool), np.zeros((views, count), bool)
    for view, pair in zip_longest(range(views), masks):
        if view is None or pair is None:
            which = "more" if view is None else f"only {view}"
            raise EpisodeError(f"there are {which} masks for {views} tracked views; give one pair for each")
        seen = tracks.visible[view]
        pixels = tracks.pixels[view, seen]
        on_object[view, seen] = inside_mask(pair.object, pixels, margin=margin)
        on_hand[view, seen] = inside_mask(pair.hand, pixels, margin=margin)
    return MaskHits(object=on_object, hand=on_hand)


def inside_mask(mask: np.ndarray, pixels: np.ndarray, *, margin: int = 0) -> np.ndarray:
    """[N] bool: pixels [N, 2], x and y, that are in a mask [H, W] bool or at most `margin` pixels beside it.

    NaN and places outside the image are in no mask.
    """
    height, width = mask.shape
    finite = np.isfinite(pixels).all(axis=1)
    column, row = np.rint(np.where(finite[:, None], pixels, -1e6)).astype(int).T
    hit = np.zeros(len(pixels), bool)
    for down in range(-margin, margin + 1):
        for across in range(-margin, margin + 1):
            x, y = column + across, row + down
            there = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            hit[there] |= mask[y[there], x[there]]
    # A place outside of the image may touch a mask at its border; it is not in view all the same.
    return hit & (column >= 0) & (column < width) & (row >= 0) & (row < height)


def stays_in_mask(hits: np.ndarray, visible: np.ndarray, *, share: float = 0.8) -> np.ndarray:
    """[N] bool: tracks in their mask in at least `share` of the views in which they are visible, and in any.

    The others slid off; of those that stay, the single views outside of the mask are to be left out by `hits`.

    Args:
        hits: [T, N] bool, one of `MaskHits`.
        visible: [T, N] bool.
        share: 0..1.
    """
    seen = visible.sum(axis=0)
    inside = (hits & visible).sum(axis=0)
    return (inside > 0) & (inside >= share * seen)


def consistent_motion(points: np.ndarray, *, bound: float = 0.015, neighbours: int = 12) -> np.ndarray:
    """[T, N] bool: points that are seen and move as the points around them do.

    A point's motion is counted from the last view in which it was kept, and so is that of its neighbours: one that
    jumps to another place is left out until it is back. It is kept if its motion differs from the median of the
    neighbours', taken along each axis, by at most `bound`, or if fewer than `FEWEST_NEIGHBOURS` neighbours are seen
    in both views. Neighbours are the nearest in the first view in which the point is seen.

    At the rim of an object the median of the neighbours is off by about their distance times the rotation since
    the last view: `bound` should not be far below the spacing of the points (of recorded ones 20 mm apart, none of a
    plush toy's and under 1 % of a folded towel's are lost at 15 mm).

    Args:
        points: [T, N, 3] metres, NaN where not seen.
        bound: metres.
        neighbours: how many, at most.

    Raises:
        EpisodeError: points are not [T, N, 3].
    """
    if points.ndim != 3 or points.shape[2] != 3:
        raise EpisodeError(f"points must be [T, N, 3] in metres, got {points.shape}")
    views, count = points.shape[:2]
    seen = np.isfinite(points).all(axis=2)
    around = first_neighbours(points, neighbours)
    kept = np.zeros((views, count), bool)
    last = np.full(count, -1)
    for view in range(views):
        known = np.flatnonzero(seen[view])
        before = last[known]
        beside = around[known]  # [K, k], -1 where there are fewer
        then = before[:, None]
        comparable = (then >= 0) & (beside >= 0) & kept[then, beside] & seen[view, beside]
        moved = np.where(comparable[:, :, None], points[view, beside] - points[then, beside], np.nan)
        judged = comparable.sum(axis=1) >= FEWEST_NEIGHBOURS
        good = np.ones(len(known), bool)
        own = points[view, known[judged]] - points[before[judged], known[judged]]
        off = np.linalg.norm(own - np.nanmedian(moved[judged], axis=1), axis=1) if judged.any() else np.zeros(0)
        good[judged] = off <= bound
        kept[view, known] = good
        last[known[good]] = view
    return kept


def first_neighbours(points: np.ndarray, count: int) -> np.ndarray:
    """[N, count] indices of the points nearest to each in the first view that shows it; -1 where there are fewer.

    Args:
        points: [T, N, 3] metres, NaN where not seen.
        count: neighbours of a point.
    """
    seen = np.isfinite(points).all(axis=2)
    around = np.full((points.shape[1], count), -1)
    if len(points) == 0:
        return around
    first = np.where(seen.any(axis=0), seen.argmax(axis=0), -1)
    for view in np.unique(first[first >= 0]):
        there = np.flatnonzero(seen[view])
        new = np.flatnonzero(first == view)
        found = min(count + 1, len(there))
        nearest = there[cKDTree(points[view, there]).query(points[view, new], k=[*range(1, found + 1)])[1]]
        # Coincident points need not find themselves first; who is not found at all is far from the last.
        own = nearest == new[:, None]
        own[~own.any(axis=1), -1] = True
        around[new, : found - 1] = nearest[~own].reshape(len(new), found - 1)
    return around


def visible_throughout(seen: np.ndarray, *, longest_gap: int = 0) -> np.ndarray:
    """[N] bool: tracks that are never unseen, [T, N] bool, for more than `longest_gap` views in a row."""
    gap = np.zeros(seen.shape[1], int)
    longest = gap.copy()
    for row in seen:
        gap = np.where(row, 0, gap + 1)
        longest = np.maximum(longest, gap)
    return longest <= longest_gap


def above_ground(points: np.ndarray, ground_height: float, *, margin: float = GROUND_MARGIN_M) -> np.ndarray:
    """[...] bool: points [..., 3] that are known and not more than `margin` metres below the ground."""
    with np.errstate(invalid="ignore"):
        above: np.ndarray = np.isfinite(points).all(axis=-1) & (points[..., 2] >= ground_height - margin)
    return above
