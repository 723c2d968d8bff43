"""The gripper holds beside the point that is recorded for it."""

import numpy as np

from egophys_core.discrepancy.effects.effect import Effect, Parameter, Surroundings, Values
from egophys_core.discrepancy.effects.hands import HAND_SIZE

LEAST_WIDTH = 0.003
"""Metres: points of a hand that spread less than this across their line say nothing of how it turns."""

FRAMES_APART = 10
"""Frames between those in which points are compared to tell which belong to one hand."""


def drive(values: Values, times: np.ndarray, controllers: np.ndarray) -> np.ndarray:
    """The hands moved by an offset that turns with them; its axes are the world's in the first frame."""
    offset = np.array([values["x"], values["y"], values["z"]])
    moved = controllers.copy()
    apart = controllers[::FRAMES_APART]
    together = (np.linalg.norm(apart[:, :, None] - apart[:, None], axis=3) < HAND_SIZE).all(axis=0)
    hands, hand_of = np.unique(together, axis=0, return_inverse=True)
    for index, hand in enumerate(hands):
        moved[:, hand_of == index] += (turns(controllers[:, hand]) @ offset)[:, None]
    return moved


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


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"x": 0.005, "y": 0.005, "z": 0.005}]


EFFECT = Effect(
    name="gripper_offset",
    summary="the hand holds beside the point recorded for it, by an offset that turns with the hand",
    equation="c(t) = c_recorded(t) + R_hand(t) (x, y, z)",
    source="Tsai and Lenz, IEEE Trans. Robotics and Automation 5 (1989) 345: hand-eye calibration",
    parameters=tuple(
        Parameter(name=axis, unit="m", low=-0.1, high=0.1, step=0.005, null=0.0) for axis in ("x", "y", "z")
    ),
    mimics=("tracking_offset", "tracking_rotation"),
    experiment="turn the wrist by 90 degrees while holding: the offset turns along, one of the tracking frame does not",
    starts=starts,
    drive=drive,
)
