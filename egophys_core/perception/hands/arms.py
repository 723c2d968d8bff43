"""Arms in the mask of the hand: which pixels are one arm, and where its hand is.

An arm that enters from the border ends in the hand; one that does not (a glove, a gripper, an arm that is seen whole)
has its hand at the end that is nearer to the object. The hand is the last part of the arm, about as long as it is wide.
"""

from dataclasses import dataclass, replace
from enum import Enum

import cv2
import numpy as np

from egophys_core.perception.hands.hand_outline import HandOutline
from egophys_core.perception.hands.landmark_depth import LandmarkGrip
from egophys_core.perception.masks.silhouette import inside

FEWEST_PIXELS = 250
"""Of an arm."""

BRIDGED_PX = 7
"""Parts of an arm that are no farther apart belong together: a cuff, or the border between two colours."""

ENTRY_GAP_PX = 60
"""Places on the border that are farther apart are two arms."""

REACH_SHARE = 0.13
"""Of the side of the view: how far from its tip the widest place of a hand is looked for."""

LENGTH_IN_RADII = 2.0
"""Length of a hand that holds or pushes, in halves of its width."""

GRIP_AHEAD = 0.5
"""From the middle of the hand towards its tip, in halves of its width: where it holds and pushes."""


class SizeCue(Enum):
    """What tells the middle of a hand and its width; those of one cue are not those of another."""

    MASK = "mask"
    OUTLINE = "outline"
    LANDMARKS = "landmarks"


@dataclass(frozen=True, kw_only=True)
class SeenArm:
    """One arm in a view."""

    mask: np.ndarray
    """[S, S] bool."""
    centre: np.ndarray
    """[2] pixel x, y: middle of its hand."""
    grip: np.ndarray
    """[2] pixel x, y: where the hand holds or pushes."""
    radius: float
    """Pixels: half of the width of the hand."""
    outline: HandOutline | None = None
    """Of the hand, where it is like an ellipse."""
    landmarks: LandmarkGrip | None = None
    """The grip by landmarks of the hand, where they were looked for and found."""

    @property
    def cue(self) -> SizeCue:
        """What its centre and radius are from."""
        if self.landmarks is not None:
            return SizeCue.LANDMARKS
        return SizeCue.MASK if self.outline is None else SizeCue.OUTLINE

    def with_outline(self, outline: HandOutline) -> "SeenArm":
        """The arm whose hand ends at an outline: middle, width and mask follow from that."""
        away = self.grip - self.centre
        forward = away / max(float(np.linalg.norm(away)), 1e-9)
        radius = outline.half_widths[0]
        return replace(
            self,
            mask=self.mask | outline.mask(self.mask.shape),
            centre=outline.centre,
            grip=outline.centre + GRIP_AHEAD * radius * forward,
            radius=radius,
            outline=outline,
        )


def find_arms(hand: np.ndarray, surface: np.ndarray) -> list[SeenArm]:
    """The arms in a mask.

    Args:
        hand: [S, S] bool, all arms.
        surface: [S, S] bool, where the object is.
    """
    bridged = cv2.dilate(hand.astype(np.uint8), np.ones((BRIDGED_PX, BRIDGED_PX), np.uint8))
    count, labels = cv2.connectedComponents(bridged, connectivity=8)
    goal = _middle(surface)
    return [
        arm
        for label in range(1, count)
        for mask, entry in _split(hand & (labels == label))
        if (arm := _arm(mask, entry, goal)) is not None
    ]


def _split(part: np.ndarray) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """Masks of the arms in one connected part, each with the place [2] where it enters the view, None if nowhere."""
    border = np.zeros_like(part)
    border[[0, -1]] = border[:, [0, -1]] = True
    places = np.argwhere(part & border)[:, ::-1].astype(float)
    if not len(places):
        return [(part, None)]
    entries: list[list[np.ndarray]] = []
    for place in places:
        near = [each for each in entries if np.linalg.norm(np.array(each) - place, axis=1).min() < ENTRY_GAP_PX]
        entries = [each for each in entries if not any(each is other for other in near)]
        entries.append([place, *(other for each in near for other in each)])
    middles = np.array([np.mean(each, axis=0) for each in entries])
    if len(middles) == 1:
        return [(part, middles[0])]
    rows, columns = np.nonzero(part)
    pixels = np.column_stack([columns, rows])
    nearest = np.linalg.norm(pixels[:, None] - middles, axis=2).argmin(axis=1)
    masks = [np.zeros_like(part) for _ in middles]
    for index, mask in enumerate(masks):
        mask[rows[nearest == index], columns[nearest == index]] = True
    return list(zip(masks, middles, strict=True))


def _arm(mask: np.ndarray, entry: np.ndarray | None, goal: np.ndarray) -> SeenArm | None:
    rows, columns = np.nonzero(mask)
    if len(rows) < FEWEST_PIXELS:
        return None
    pixels = np.column_stack([columns, rows]).astype(float)
    if entry is None:
        entry = pixels[np.linalg.norm(pixels - goal, axis=1).argmax()]
    along = np.linalg.norm(pixels - entry, axis=1)
    tip = pixels[along >= np.percentile(along, 99.5)].mean(axis=0)
    from_tip = np.linalg.norm(pixels - tip, axis=1)
    # Padded, so that the border of the view is no longer taken for the middle of an arm that is cut there.
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1][rows, columns]
    radius = float(depth[from_tip < REACH_SHARE * len(mask)].max())
    centre = pixels[from_tip < LENGTH_IN_RADII * radius].mean(axis=0)
    away = tip - centre
    forward = away / max(float(np.linalg.norm(away)), 1e-9)
    return SeenArm(mask=mask, centre=centre, grip=centre + GRIP_AHEAD * radius * forward, radius=radius)


def arm_at(outline: HandOutline, surface: np.ndarray) -> SeenArm:
    """A hand of which nothing but the outline is seen; it holds on the side of the object, [S, S] bool."""
    radius = outline.half_widths[0]
    away = _middle(surface) - outline.centre
    grip = outline.centre + GRIP_AHEAD * radius * away / max(float(np.linalg.norm(away)), 1e-9)
    mask = outline.mask(surface.shape)
    return SeenArm(mask=mask, centre=outline.centre, grip=grip, radius=radius, outline=outline)


def _middle(mask: np.ndarray) -> np.ndarray:
    """[2] pixel x, y: of a mask [S, S] bool, of the view if it is empty."""
    return np.argwhere(mask)[:, ::-1].mean(axis=0) if mask.any() else np.array(mask.shape[::-1]) / 2


def is_near(arm: SeenArm, surface: np.ndarray) -> bool:
    """Whether the hand of an arm may touch the object, whose silhouette is [S, S] bool."""
    reach = int(arm.radius)
    widened = cv2.dilate(surface.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0
    x, y = inside(arm.grip[None], surface.shape)[0]
    return bool(widened[y, x])
