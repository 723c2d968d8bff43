"""Arms whose hands a landmarker finds, too: their grip and their size are those of the landmarks."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from egophys_core.perception.hands.arms import SeenArm
from egophys_core.perception.hands.grip import USUAL_HALF_WIDTH_M
from egophys_core.perception.hands.landmark_depth import LandmarkGrip, landmark_grip
from egophys_core.perception.stages import HandLandmarker, HandLandmarks, View


class LandmarkedArms:
    """Arms from view to view, with what landmarks tell of them.

    The half width of an arm becomes that of a usual hand as deep in the view as the landmarks are.
    """

    def __init__(self, landmarker: HandLandmarker) -> None:
        self._landmarker = landmarker

    def next(self, arms: Mapping[int, SeenArm], view: View) -> dict[int, SeenArm]:
        """The arms of the next view, by the hand's number, as they come; landmarks are looked for if there are any."""
        hands = self._landmarker.hands(view) if arms else []
        grips = grips_of_arms(arms, hands, view.camera_matrix)
        return {number: _corrected(arm, grips.get(number), view) for number, arm in arms.items()}


def _corrected(arm: SeenArm, grip: LandmarkGrip | None, view: View) -> SeenArm:
    if grip is None:
        return arm
    radius = float(view.camera_matrix[0, 0]) * USUAL_HALF_WIDTH_M / grip.depth
    return replace(arm, centre=grip.pixel, grip=grip.pixel, radius=radius, landmarks=grip)


def grips_of_arms(
    arms: Mapping[int, SeenArm], hands: list[HandLandmarks], camera_matrix: np.ndarray
) -> dict[int, LandmarkGrip]:
    """By the arm's number, where its hand holds or pushes; of those arms whose hand was found.

    A hand is that of the nearest arm whose mask its middle is in, or beside by no more than half of its width; of
    several the likeliest.

    Args:
        arms: by number.
        hands: landmarks, in any order.
        camera_matrix: [3, 3] pixels.
    """
    found: dict[int, LandmarkGrip] = {}
    for hand in sorted(hands, key=lambda each: -each.score):
        grip = landmark_grip(hand, camera_matrix)
        if grip is None:
            continue
        middle = np.nanmean(hand.pixels, axis=0)
        away = {number: _distance(arm.mask, middle) for number, arm in arms.items() if number not in found}
        near = {number: apart for number, apart in away.items() if apart <= arms[number].radius}
        if near:
            found[min(near, key=near.__getitem__)] = grip
    return found


def _distance(mask: np.ndarray, pixel: np.ndarray) -> float:
    """Pixels from a place [2] x, y to the nearest pixel of a mask [S, S]."""
    rows, columns = np.nonzero(mask)
    return float(np.hypot(columns - pixel[0], rows - pixel[1]).min())
