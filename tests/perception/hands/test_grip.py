"""The hand in the image: its motion, what it hides and therefore holds."""

import cv2
import numpy as np
import pytest

from egophys_core.perception.hands.grip import HeldVertices, carried, follow, hand_motion, take_hold, tip_of_hand
from egophys_core.perception.stages import Masks

SIZE, FOCAL = 160, 300.0


def hand_mask() -> np.ndarray:
    """A bar from the right whose tip is at x = 90."""
    hand = np.zeros((SIZE, SIZE), bool)
    hand[70:90, 90:] = True
    return hand


def sheet_mask() -> np.ndarray:
    covered = np.zeros((SIZE, SIZE), bool)
    covered[40:120, 30:110] = True
    return covered


def picture() -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(0).normal(size=(SIZE, SIZE)), (0, 0), 5.0)
    return (128 + 50 * noise / noise.std()).clip(0, 255).astype(np.uint8)


def vertices() -> np.ndarray:
    """[V, 3] pixels and depth, half a metre away."""
    grid = np.stack(np.meshgrid(np.arange(30, 111, 5.0), np.arange(40, 121, 5.0)), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.full(len(grid), 0.5)])


FLOW = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)


@pytest.mark.parametrize(
    ("angle", "scale", "shift"), [(0.0, 1.0, (4.0, -2.0)), (2.0, 1.0, (1.0, 3.0)), (0.0, 1.03, (0.0, 0.0))]
)
def test_motion_of_the_hand_is_found_though_the_rest_stands(
    angle: float, scale: float, shift: tuple[float, float]
) -> None:
    before = picture()
    hand = np.zeros((SIZE, SIZE), bool)
    hand[40:120, 60:140] = True
    true = cv2.getRotationMatrix2D((100.0, 80.0), angle, scale)
    true[:, 2] += shift
    moved = cv2.warpAffine(before, true, (SIZE, SIZE), borderMode=cv2.BORDER_REFLECT)
    there = cv2.warpAffine(hand.astype(np.uint8), true, (SIZE, SIZE)) > 0
    motion = hand_motion(before, np.where(there, moved, before), hand, FLOW)
    assert motion is not None
    middle = np.array([[90.0, 80], [110, 75]])
    np.testing.assert_allclose(carried(middle, motion), carried(middle, true), atol=1.0)


def test_no_hand_has_no_motion() -> None:
    assert hand_motion(picture(), picture(), np.zeros((SIZE, SIZE), bool), FLOW) is None


def test_carried_is_the_similarity() -> None:
    quarter = np.array([[0.0, -1, 10], [1, 0, 0]])
    np.testing.assert_allclose(carried(np.array([[2.0, 3], [0, 0]]), quarter), [[7, 2], [10, 0]])


def test_the_tip_is_the_hand_deepest_in_the_object() -> None:
    tip = tip_of_hand(hand_mask(), sheet_mask())
    assert tip is not None
    assert tip[0] == pytest.approx(90, abs=1)
    assert 70 <= tip[1] < 90
    assert tip_of_hand(np.zeros_like(hand_mask()), sheet_mask()) is None
    assert tip_of_hand(hand_mask(), np.zeros_like(hand_mask())) is None


def test_hidden_vertices_near_the_tip_are_held() -> None:
    masks = Masks(object=sheet_mask() & ~hand_mask(), hand=hand_mask())
    grip = take_hold(vertices(), masks, sheet_mask(), FOCAL)
    assert grip is not None
    x, y = grip.pixels.T
    assert hand_mask()[y.astype(int), x.astype(int)].all()
    np.testing.assert_array_equal(grip.pixels, vertices()[grip.vertices, :2])
    # 20 mm half a metre away are 12 pixels.
    assert np.linalg.norm(grip.pixels - [90, 80], axis=1).max() < 25


def test_a_hand_beside_the_object_holds_nothing() -> None:
    beside = np.zeros((SIZE, SIZE), bool)
    beside[70:90, 120:] = True
    assert take_hold(vertices(), Masks(object=sheet_mask(), hand=beside), sheet_mask(), FOCAL) is None


def test_held_vertices_go_along_until_they_leave_the_hand() -> None:
    grip = HeldVertices(vertices=np.array([4, 8]), pixels=np.array([[95.0, 80], [92, 74]]))
    stay = np.array([[1.0, 0, 0], [0, 1, 0]])
    kept = follow(grip, stay, hand_mask())
    assert kept is not None
    np.testing.assert_array_equal(kept.vertices, [4, 8])
    half = follow(grip, stay + [[0, 0, 0], [0, 0, -22.0]], hand_mask())
    assert half is not None
    np.testing.assert_array_equal(half.vertices, [4])
    assert follow(grip, stay + [[0, 0, 0], [0, 0, -60.0]], hand_mask()) is None
    assert follow(grip, stay, np.zeros_like(hand_mask())) is None
