"""Where a hand holds or pushes the object, from view to view.

A hand holds what it covers when the object begins to move. From then on that place goes along with the hand, which
moves in the image by a similarity, fitted to the optical flow of its pixels. Flow drifts, so the place is drawn back to
where it was beside the middle of the hand.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from egophys_core.perception.hands.arms import SeenArm

FEWEST_PIXELS = 60
"""Of a hand, to fit a motion to."""

FLOW_STEP = 3
"""Every so many pixels of the hand are used."""

FLOW_MISS_PX = 1.5
"""Pixels: flow that is farther from the similarity is of something else."""

HAND_IN_RADII = 3.0
"""From the middle of a hand, in halves of its width: what moves with it; the arm behind turns otherwise."""

FEWEST_COVERED = 300
"""Pixels of the object that a hand covers, from which on their middle tells where it holds."""

HELD_SHARE = 0.15
"""Share of the hand's disc that covers the object where it holds it: 0.3 to 0.6 in holds, 0.05 in a push."""

HELD_RADIUS_M = 0.025
"""Metres around the grip: what is held; about a finger and a thumb."""

PULL_BACK = 0.15
"""Share of the drift against the middle of the hand that is taken off in a view."""


@dataclass(frozen=True, kw_only=True)
class HandGrip:
    """Where a hand acts on the object, in one view."""

    pixel: np.ndarray
    """[2] x, y."""
    beside: np.ndarray
    """[2] pixels: from the middle of the hand to it, when the contact began."""
    vertices: np.ndarray
    """[H] int: vertices of the object that were there then; none of a hand that pushes, which covers nothing."""


def hand_motion(flow: np.ndarray, before: SeenArm) -> np.ndarray | None:
    """[2, 3] similarity that moves a hand's pixels from one view to the next; None if there is too little to see.

    Args:
        flow: [S, S, 2] pixels, from the earlier view to the later.
        before: the arm in the earlier view.
    """
    rows, columns = np.nonzero(before.mask)
    near = np.hypot(columns - before.centre[0], rows - before.centre[1]) < HAND_IN_RADII * before.radius
    rows, columns = rows[near][::FLOW_STEP], columns[near][::FLOW_STEP]
    if len(rows) < FEWEST_PIXELS / FLOW_STEP:
        return None
    start = np.column_stack([columns, rows]).astype(np.float32)
    end = start + flow[rows, columns]
    cv2.setRNGSeed(0)
    motion, _ = cv2.estimateAffinePartial2D(start, np.ascontiguousarray(end), ransacReprojThreshold=FLOW_MISS_PX)
    return motion


def carried(pixels: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """[N, 2] pixels after a similarity [2, 3]."""
    return pixels @ motion[:, :2].T + motion[:, 2]


def take_grip(arm: SeenArm, surface: np.ndarray, vertices: np.ndarray, focal: float) -> HandGrip:
    """Where a hand acts when the object begins to move: by its landmarks, else in the middle of what it covers, else
    ahead of its middle.

    Args:
        arm: of the hand.
        surface: [S, S] bool: where the object is, seen or hidden.
        vertices: [V, 3] pixels and depth in metres, of the object.
        focal: focal length, pixels.
    """
    rows, columns = np.nonzero(arm.mask & surface)
    by_cover = arm.landmarks is None and len(rows) >= FEWEST_COVERED
    pixel = np.array([columns.mean(), rows.mean()]) if by_cover else arm.grip
    away = np.linalg.norm(vertices[:, :2] - pixel, axis=1) * vertices[:, 2] / focal
    is_held = len(rows) >= HELD_SHARE * np.pi * arm.radius**2
    there = np.flatnonzero(is_held & (away <= max(HELD_RADIUS_M, float(away.min()))))
    return HandGrip(pixel=pixel, beside=pixel - arm.centre, vertices=there)


def follow(grip: HandGrip, motion: np.ndarray | None, arm: SeenArm) -> HandGrip:
    """The grip in the next view, in which the hand was found."""
    if arm.landmarks is not None:
        return replace(grip, pixel=arm.grip, beside=arm.grip - arm.centre)
    if motion is None:
        return replace(grip, pixel=arm.centre + grip.beside)
    pixel = carried(grip.pixel[None], motion)[0]
    return replace(grip, pixel=pixel - PULL_BACK * (pixel - arm.centre - grip.beside))
