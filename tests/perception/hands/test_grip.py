"""Where a hand holds: its motion in the image, and the place that goes along."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from egophys_core.perception.hands.arms import SeenArm, find_arms
from egophys_core.perception.hands.grip import carried, follow, hand_motion, take_grip
from egophys_core.perception.hands.landmark_depth import LandmarkGrip
from tests.perception.hands.arm_drawing import SIDE, arm_mask, disc

FOCAL = 300.0
OBJECT = disc((110, 160), 70)
STAY = np.array([[1.0, 0, 0], [0, 1, 0]])


def arm_at(x: int = 190, y: int = 160) -> SeenArm:
    return find_arms(arm_mask((SIDE - 1, 160), (x, y)), OBJECT)[0]


def vertices() -> np.ndarray:
    """[V, 3] pixels and depth, half a metre away, 5 pixels apart."""
    grid = np.stack(np.meshgrid(np.arange(40, 181, 5.0), np.arange(100, 221, 5.0)), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.full(len(grid), 0.5)])


@pytest.mark.parametrize(
    ("angle", "scale", "shift"), [(0.0, 1.0, (4.0, -2.0)), (2.0, 1.0, (1.0, 3.0)), (0.0, 1.03, (0.0, 0.0))]
)
def test_motion_of_the_hand_is_found_though_the_rest_stands(
    angle: float, scale: float, shift: tuple[float, float]
) -> None:
    noise = cv2.GaussianBlur(np.random.default_rng(0).normal(size=(SIDE, SIDE)), (0, 0), 5.0)
    before = (128 + 50 * noise / noise.std()).clip(0, 255).astype(np.uint8)
    (arm,) = find_arms(arm_mask((SIDE - 1, 160), (190, 160), radius=40, half_width=30), OBJECT)
    true = cv2.getRotationMatrix2D((200.0, 160.0), angle, scale)
    true[:, 2] += shift
    moved = cv2.warpAffine(before, true, (SIDE, SIDE), borderMode=cv2.BORDER_REFLECT)
    there = cv2.warpAffine(arm.mask.astype(np.uint8), true, (SIDE, SIDE)) > 0
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST).calc(before, np.where(there, moved, before), None)
    motion = hand_motion(flow, arm)
    assert motion is not None
    middle = np.array([[190.0, 160], [205, 155]])
    np.testing.assert_allclose(carried(middle, motion), carried(middle, true), atol=1.0)


def test_an_arm_that_turns_behind_the_hand_does_not_count() -> None:
    arm = arm_at(80)
    flow = np.zeros((SIDE, SIDE, 2), np.float32)
    flow[:, :165] = [3.0, 1.0]
    flow[:, 165:] = [-8.0, 9.0]
    motion = hand_motion(flow, arm)
    assert motion is not None
    np.testing.assert_allclose(motion, [[1, 0, 3], [0, 1, 1]], atol=1e-4)


def test_carried_is_the_similarity() -> None:
    quarter = np.array([[0.0, -1, 10], [1, 0, 0]])
    np.testing.assert_allclose(carried(np.array([[2.0, 3], [0, 0]]), quarter), [[7, 2], [10, 0]])


def test_a_hand_holds_the_middle_of_what_it_covers() -> None:
    arm = arm_at(160)
    grip = take_grip(arm, OBJECT, vertices(), FOCAL)
    # The object ends at x = 180; the hand's disc of 26 pixels begins at 134.
    assert grip.pixel == pytest.approx([(134 + 180) / 2, 160], abs=2)
    np.testing.assert_allclose(grip.beside, grip.pixel - arm.centre)
    # A finger and a thumb reach 2 to 3 cm: 12 to 18 pixels at half a metre.
    away = np.linalg.norm(vertices()[:, :2] - grip.pixel, axis=1)
    assert set(np.flatnonzero(away < 12)) <= set(grip.vertices)
    assert away[grip.vertices].max() < 18


def test_a_hand_that_hardly_covers_the_object_holds_ahead_of_its_middle() -> None:
    arm = arm_at(210)
    np.testing.assert_array_equal(take_grip(arm, OBJECT, vertices(), FOCAL).pixel, arm.grip)
    assert arm.grip[0] < arm.centre[0]


def test_the_place_goes_along_with_the_hand() -> None:
    grip = take_grip(arm_at(), OBJECT, vertices(), FOCAL)
    shift = np.array([6.0, 3.0])
    later = follow(grip, np.column_stack([np.eye(2), shift]), arm_at(196, 163))
    np.testing.assert_allclose(later.pixel, grip.pixel + shift, atol=0.5)


def test_without_a_motion_it_jumps_to_the_hand() -> None:
    arm, there = arm_at(), arm_at(240, 180)
    grip = take_grip(arm, OBJECT, vertices(), FOCAL)
    np.testing.assert_allclose(follow(grip, None, there).pixel - there.centre, grip.pixel - arm.centre)


def test_landmarks_tell_the_place_where_they_are_found_and_where_it_is_beside_the_hand() -> None:
    arm, place = arm_at(160), np.array([130.0, 150])
    by_landmarks = replace(arm, grip=place, landmarks=LandmarkGrip(pixel=place, depth=0.5, sigma=0.03))
    np.testing.assert_array_equal(take_grip(by_landmarks, OBJECT, vertices(), FOCAL).pixel, place)
    drifting = STAY + [[0, 0, 20.0], [0, 0, 20.0]]
    grip = follow(take_grip(arm, OBJECT, vertices(), FOCAL), drifting, by_landmarks)
    np.testing.assert_array_equal(grip.pixel, place)
    there = arm_at(200, 175)
    np.testing.assert_allclose(follow(grip, None, there).pixel - there.centre, place - arm.centre)


def test_drift_of_the_flow_is_taken_off() -> None:
    arm = arm_at()
    first = grip = take_grip(arm, OBJECT, vertices(), FOCAL)
    drifting = STAY + [[0, 0, 0.5], [0, 0, 0.5]]
    for _ in range(60):
        grip = follow(grip, drifting, arm)
    # Without it, 60 views of half a pixel are 30 pixels.
    assert np.abs(grip.pixel - first.pixel).max() < 5
