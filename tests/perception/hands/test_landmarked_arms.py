"""Arms with landmarks: which hand is of which arm, and what becomes of its grip and its size."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.perception.hands.arms import SeenArm, find_arms
from egophys_core.perception.hands.grip import USUAL_HALF_WIDTH_M, depth_by_width
from egophys_core.perception.hands.landmarked_arms import LandmarkedArms, grips_of_arms
from egophys_core.perception.stages import HandLandmarks, View
from tests.perception.hands.arm_drawing import SIDE, arm_mask, disc
from tests.perception.hands.drawn_hand import MATRIX, flat_hand, pinching_hand, seen_hand

OBJECT = disc((160, 160), 50)
VIEW = View(
    stamp_ns=0,
    image=np.zeros((SIDE, SIDE, 3), np.uint8),
    camera_matrix=MATRIX,
    world_from_camera=np.full((4, 4), np.nan),
)


class KnownHands:
    """A `HandLandmarker` that is told what to find."""

    def __init__(self, *views: list[HandLandmarks]) -> None:
        self.views = iter(views)

    def hands(self, view: View) -> list[HandLandmarks]:
        assert view is VIEW
        return next(self.views)


def arms() -> dict[int, SeenArm]:
    (left,) = find_arms(arm_mask((0, 200), (110, 160)), OBJECT)
    (right,) = find_arms(arm_mask((SIDE - 1, 200), (215, 160)), OBJECT)
    return {0: left, 1: right}


def test_each_hand_goes_to_its_arm():
    left, right = seen_hand(flat_hand(), (108, 165), 0.5), seen_hand(flat_hand(), (218, 165), 0.7)
    found = grips_of_arms(arms(), [right, left], MATRIX)
    np.testing.assert_allclose(found[0].pixel, left.pixels[12])
    np.testing.assert_allclose(found[1].pixel, right.pixels[12])
    assert found[0].depth == pytest.approx(0.5, abs=0.02)
    assert found[1].depth == pytest.approx(0.7, abs=0.02)


def test_a_hand_beside_its_arm_by_less_than_half_a_width_is_of_it_and_one_elsewhere_is_not():
    above = 160 - arms()[0].radius
    # The hand on the mask is a disc of 26 pixels.
    assert set(grips_of_arms(arms(), [seen_hand(flat_hand(), (110, above - 20), 0.5)], MATRIX)) == {0}
    assert grips_of_arms(arms(), [seen_hand(flat_hand(), (110, above - 32), 0.5)], MATRIX) == {}
    assert grips_of_arms(arms(), [seen_hand(flat_hand(), (160, 60), 0.5)], MATRIX) == {}


def test_of_two_hands_on_one_arm_the_likelier_is_taken():
    doubtful, sure = (seen_hand(flat_hand(), (110, 160), 0.5, score=score) for score in (0.6, 0.8))
    sure = replace(sure, pixels=sure.pixels + 3)
    for hands in ([doubtful, sure], [sure, doubtful]):
        np.testing.assert_allclose(grips_of_arms(arms(), hands, MATRIX)[0].pixel, sure.pixels[12])


def test_hands_that_tell_nothing_are_left_out():
    lost = replace(seen_hand(flat_hand(), (110, 160), 0.5), pixels=np.full((21, 2), np.nan))
    assert grips_of_arms(arms(), [lost], MATRIX) == {}


def test_landmarks_replace_grip_and_depth_of_the_shape():
    hand = seen_hand(pinching_hand(), (110, 160), 0.43)
    before = arms()
    after = LandmarkedArms(KnownHands([hand])).next(before, VIEW)
    assert after[1] is before[1]
    assert after[0].landmarks is not None
    np.testing.assert_allclose(after[0].grip, hand.pixels[[4, 8]].mean(axis=0))
    assert after[0].mask is before[0].mask
    np.testing.assert_array_equal(after[0].centre, after[0].grip)
    assert depth_by_width(USUAL_HALF_WIDTH_M, after[0], VIEW) == pytest.approx(after[0].landmarks.depth)
    assert after[0].landmarks.depth == pytest.approx(0.43, abs=0.04)


def test_nothing_is_looked_for_without_arms():
    assert LandmarkedArms(KnownHands()).next({}, VIEW) == {}
