"""What a hand holds: how the hand moves in the image, and which vertices go along.

From view to view a hand moves in the image by a similarity, fitted to the optical flow of its pixels. When the object
begins to move while the hand is at it, the vertices about the grip are held: from then on they are where the hand
carries them. Flow drifts, so they are drawn back to where they were beside the middle of the hand.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.hands.arms import Arm

FEWEST_PIXELS = 60
"""Of a hand, to fit a motion to."""

FLOW_STEP = 3
"""Every so many pixels of the hand are used."""

FLOW_MISS_PX = 1.5
"""Pixels: flow that is farther from the similarity is of something else."""

HAND_IN_RADII = 3.0
"""From the middle of a hand, in halves of its width: what moves with it; the arm behind turns otherwise."""

HELD_RADIUS_M = 0.025
"""Metres around the grip within which vertices are held; about a finger and a thumb."""

PULL_BACK = 0.15
"""Share of the drift against the middle of the hand that is taken off in a view."""


@dataclass(frozen=True, kw_only=True)
class HeldVertices:
    """Vertices that a hand holds."""

    vertices: np.ndarray
    """[H] int."""
    pixels: np.ndarray
    """[H, 2]: where the hand has carried them."""
    beside: np.ndarray
    """[2] pixels: their middle less that of the hand, when it took hold."""


def hand_motion(flow: np.ndarray, before: Arm) -> np.ndarray | None:
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


def take_hold(vertices: np.ndarray, arm: Arm, focal: float) -> HeldVertices | None:
    """Vertices about the grip of a hand; None if there are none.

    Args:
        vertices: [V, 3]: pixels and depth in metres.
        arm: in the view in which the object begins to move.
        focal: focal length, pixels.
    """
    away = np.linalg.norm(vertices[:, :2] - arm.grip, axis=1) * vertices[:, 2] / focal
    held = np.flatnonzero(away < HELD_RADIUS_M)
    if not len(held):
        return None
    pixels = vertices[held, :2]
    return HeldVertices(vertices=held, pixels=pixels, beside=pixels.mean(axis=0) - arm.centre)


def follow(held: HeldVertices, motion: np.ndarray | None, arm: Arm) -> HeldVertices:
    """What is held in the next view, in which the hand was found."""
    pixels = held.pixels if motion is None else carried(held.pixels, motion)
    drift = pixels.mean(axis=0) - (arm.centre + held.beside)
    share = 1.0 if motion is None else PULL_BACK
    return HeldVertices(vertices=held.vertices, pixels=pixels - share * drift, beside=held.beside)
