"""The hand in the image: how it moves, which vertices it holds, and points of it in space.

From view to view the hand moves in the image by a similarity, fitted to the optical flow of its pixels. When the object
begins to move while the hand is on it, the vertices that the tip of the hand hides are held: from then on they are
where the hand carries them, until they come out of it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.masks.silhouette import inside
from egophys_core.perception.stages import Masks

FEWEST_PIXELS = 60
"""Of a hand, to fit a motion to."""

FLOW_STEP = 5
"""Every so many pixels of the hand are used."""

FLOW_MISS_PX = 1.5
"""Pixels: flow that is farther from the similarity is of something else."""

HELD_RADIUS_M = 0.02
"""Metres around the tip within which vertices are held; about a finger and a thumb."""

RELEASED_PX = 15
"""Pixels: held vertices this far out of the hand's mask have slipped out or been let go."""


@dataclass(frozen=True, kw_only=True)
class HeldVertices:
    """Vertices that the hand holds."""

    vertices: np.ndarray
    """[H] int."""
    pixels: np.ndarray
    """[H, 2]: where the hand has carried them."""


def hand_motion(before: np.ndarray, after: np.ndarray, hand: np.ndarray, flow: cv2.DISOpticalFlow) -> np.ndarray | None:
    """[2, 3] similarity that moves the hand's pixels from one view to the next; None if there is too little to see.

    Args:
        before: [S, S] uint8, grey.
        after: [S, S] uint8, grey, the next view.
        hand: [S, S] bool, the hand in the earlier view.
        flow: the estimator.
    """
    rows, columns = np.nonzero(hand)
    if len(rows) < FEWEST_PIXELS:
        return None
    chosen = slice(None, None, FLOW_STEP)
    start = np.column_stack([columns[chosen], rows[chosen]]).astype(np.float32)
    end = start + flow.calc(before, after, None)[rows[chosen], columns[chosen]]
    cv2.setRNGSeed(0)
    motion, _ = cv2.estimateAffinePartial2D(start, np.ascontiguousarray(end), ransacReprojThreshold=FLOW_MISS_PX)
    return motion


def hand_width(hand: np.ndarray) -> float | None:
    """Pixels: standard deviation of the pixels of a hand [S, S] across its long axis; None if it is cut or tiny."""
    rows, columns = np.nonzero(hand)
    if len(rows) < FEWEST_PIXELS:
        return None
    last = hand.shape[0] - 1
    if min(rows.min(), columns.min()) == 0 or max(rows.max(), columns.max()) == last:
        return None
    return float(np.sqrt(np.linalg.eigvalsh(np.cov(np.stack([columns, rows])))[0]))


def carried(pixels: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """[N, 2] pixels after a similarity [2, 3]."""
    return pixels @ motion[:, :2].T + motion[:, 2]


def tip_of_hand(hand: np.ndarray, covered: np.ndarray) -> np.ndarray | None:
    """[2] pixel x, y of the hand that lies deepest in the silhouette [S, S] of the object; None if none does."""
    depth = cv2.distanceTransform(covered.astype(np.uint8), cv2.DIST_L2, 5) * hand
    if depth.max() <= 0:
        return None
    row, column = np.unravel_index(int(depth.argmax()), depth.shape)
    return np.array([column, row], float)


def take_hold(vertices: np.ndarray, masks: Masks, covered: np.ndarray, focal: float) -> HeldVertices | None:
    """Vertices that the tip of the hand hides; None if it hides none.

    Args:
        vertices: [V, 3]: pixels and depth in metres.
        masks: of the view in which the object begins to move.
        covered: [S, S] bool: silhouette of the surface.
        focal: focal length, pixels.
    """
    tip = tip_of_hand(masks.hand, covered)
    if tip is None:
        return None
    x, y = inside(vertices[:, :2], masks.hand.shape).T
    away = np.linalg.norm(vertices[:, :2] - tip, axis=1) * vertices[:, 2] / focal
    held = np.flatnonzero(masks.hand[y, x] & (away < HELD_RADIUS_M))
    return HeldVertices(vertices=held, pixels=vertices[held, :2]) if len(held) else None


def follow(grip: HeldVertices, motion: np.ndarray, hand: np.ndarray) -> HeldVertices | None:
    """The grip in the next view, without vertices that have come out of the hand [S, S]; None if none is left."""
    pixels = carried(grip.pixels, motion)
    size = 2 * RELEASED_PX + 1
    near = cv2.dilate(hand.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    x, y = inside(pixels, hand.shape).T
    kept = near[y, x]
    return HeldVertices(vertices=grip.vertices[kept], pixels=pixels[kept]) if kept.any() else None
