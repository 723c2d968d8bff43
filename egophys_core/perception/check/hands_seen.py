"""When hands come in and how many, from their masks."""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.stages import Masks

SMALLEST = 0.002
"""Share of the view that is a hand at least; smaller parts are shadows and noise."""
_SECOND = 0.25
"""A second hand is at least this share of the first."""
_REACH = 41
"""Pixels: width of the neighbourhood of the object, or of the hand in the next view, that a hand reaches into."""
_USUAL = 0.3
"""Share of the views with a hand in which there are two, for two."""


@dataclass(frozen=True, kw_only=True)
class HandsSeen:
    """Hands over a video."""

    areas: np.ndarray
    """[M] share of the view that shows hands, by masked view."""
    count: int
    """0, 1 or 2."""
    first_s: float
    """When the first one comes, seconds from the start; NaN if none does."""


def hands_seen(times: np.ndarray, masks: tuple[Masks, ...]) -> HandsSeen:
    """Look at the masks [M] of views at times [M], seconds.

    What is taken for a hand counts if it meets the object, or leads to what does in the next view: things that lie
    about, and come into view as the head moves, do neither.
    """
    areas, parts = np.zeros(len(masks)), np.zeros(len(masks), int)
    later = np.zeros(masks[0].hand.shape, bool) if masks else np.zeros((0, 0), bool)
    for index in reversed(range(len(masks))):
        hand, thing = masks[index].hand, masks[index].object
        labels, stats = cv2.connectedComponentsWithStats(hand.astype(np.uint8), connectivity=8)[1:3]
        reached = cv2.dilate((thing | later).astype(np.uint8), np.ones((_REACH, _REACH), np.uint8)) > 0
        hits = np.bincount(labels[reached & hand], minlength=len(stats)) > 0
        large = stats[:, cv2.CC_STAT_AREA] >= SMALLEST * hand.size
        counted = np.flatnonzero(hits & large)
        sizes = stats[counted, cv2.CC_STAT_AREA] / hand.size
        later = np.isin(labels, counted) & hand
        areas[index] = sizes.sum()
        parts[index] = np.count_nonzero(sizes >= _SECOND * sizes.max()) if len(sizes) else 0
    # One view alone may be mistaken: a hand stays for two.
    there = parts > 0
    stays = there & np.append(there[1:], there[-1:])
    two = np.count_nonzero(parts >= 2) >= _USUAL * max(np.count_nonzero(there), 1)
    return HandsSeen(
        areas=areas,
        count=0 if not stays.any() else 2 if two else 1,
        first_s=float(times[np.argmax(stays)]) if stays.any() else np.nan,
    )
