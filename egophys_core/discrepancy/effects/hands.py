"""What effects of grip and tracking need to know of the hands: which points are one hand, where it took hold."""

from dataclasses import dataclass

import numpy as np

from egophys_core.discrepancy.effects.effect import Scene

HAND_SIZE = 0.15
"""Metres: controller points nearer to each other than this are taken for one hand."""

LEAST_WIDTH = 0.003
"""Metres: points of a hand that spread less than this across their line say nothing of how it turns."""


@dataclass(frozen=True, kw_only=True)
class Grip:
    """What an effect that moves the hands remembers of them."""

    holds: np.ndarray
    """[C] bool: controllers that hold or press in the last frame."""
    anchors: np.ndarray
    """[C, 3] metres, by the record: where each took hold."""
    shift: np.ndarray
    """[C, 3] metres by which the effect had moved each at the end of the last frame."""


def holding(scene: Scene) -> np.ndarray:
    """[C] bool: controllers that hold or press."""
    holds = np.zeros(len(scene.controllers), bool)
    holds[scene.held[:, 1]] = True
    return holds


def moved_since_hold(scene: Scene, before: Grip | None) -> tuple[np.ndarray, Grip]:
    """How far each controller will have moved by the record, at the end of the frame, since it took hold.

    Returns:
        [C, 3] metres, 0 for one that does not hold, and the grip with the shift of the last frame.
    """
    holds = holding(scene)
    shift = np.zeros(scene.controllers.shape) if before is None else before.shift
    recorded = scene.controllers - shift
    stays = holds & (before.holds if before is not None else False)
    anchors = recorded if before is None else np.where(stays[:, None], before.anchors, recorded)
    moved = recorded + scene.duration * scene.controller_velocities - anchors
    return np.where(holds[:, None], moved, 0.0), Grip(holds=holds, anchors=anchors, shift=shift)


def turns(points: np.ndarray) -> np.ndarray:
    """[F, 3, 3] rotations of points [F, P, 3] from the first frame to each, by least squares (Kabsch, 1976).

    No rotation where the points lie on a line.
    """
    centred = points - points.mean(axis=1, keepdims=True)
    spreads = np.linalg.svd(centred[0], compute_uv=False)
    if len(spreads) < 2 or spreads[1] < LEAST_WIDTH:
        return np.tile(np.eye(3), (len(points), 1, 1))
    left, _, right = np.linalg.svd(np.einsum("pi,fpj->fij", centred[0], centred))
    # A reflection would fit flat hands as well.
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return np.swapaxes(left @ right, 1, 2)
