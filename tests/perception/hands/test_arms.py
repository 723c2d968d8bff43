"""Arms in drawn masks: which pixels are one arm, and where its hand is."""

import numpy as np
import pytest

from egophys_core.perception.hands.arms import find_arms, is_near
from tests.perception.hands.arm_drawing import SIDE, Place, arm_mask, disc, together

OBJECT = disc((160, 160), 50)
LAST = SIDE - 1


@pytest.mark.parametrize(
    ("start", "end"),
    [((LAST, 150), (210, 160)), ((150, LAST), (165, 200)), ((LAST, LAST), (200, 195)), ((40, 0), (120, 110))],
    ids=["from the right", "from below", "from a corner", "slanted"],
)
def test_hand_is_at_the_end_of_an_arm_from_the_border(start: Place, end: Place) -> None:
    mask = arm_mask(start, end, radius=26)
    (arm,) = find_arms(mask, OBJECT)
    np.testing.assert_array_equal(arm.mask, mask)
    assert arm.radius == pytest.approx(26, abs=2)
    forward = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    # The fingers, which hold, are ahead of the middle of the hand.
    np.testing.assert_allclose(arm.grip, end + 0.5 * 26 * forward, atol=2)
    assert np.linalg.norm(arm.centre - end) < 6


def test_hand_does_not_depend_on_how_much_of_the_arm_is_seen() -> None:
    long = find_arms(arm_mask((LAST, 160), (110, 160)), OBJECT)[0]
    cut = find_arms(np.roll(arm_mask((LAST, 160), (110, 160)), 110, axis=1) & ~disc((60, 160), 60), OBJECT)[0]
    np.testing.assert_allclose(cut.grip - [110, 0], long.grip, atol=1)
    assert cut.radius == pytest.approx(long.radius, abs=1)


def test_two_arms_that_touch_are_two() -> None:
    left, right = arm_mask((0, 250), (136, 165)), arm_mask((LAST, 250), (184, 165))
    arms = sorted(find_arms(together([left, right]), OBJECT), key=lambda arm: arm.centre[0])
    assert len(arms) == 2
    assert not (arms[0].mask & arms[1].mask).any()
    for arm, true, end in zip(arms, (left, right), ((136, 165), (184, 165)), strict=True):
        assert (arm.mask & true).sum() > 0.95 * true.sum()
        assert np.linalg.norm(arm.centre - end) < 8


def test_a_cuff_does_not_cut_an_arm() -> None:
    mask = arm_mask((LAST, 160), (180, 160))
    mask[:, 250:254] = False
    assert len(find_arms(mask, OBJECT)) == 1
    mask[:, 240:270] = False
    assert len(find_arms(mask, OBJECT)) == 2


def test_a_glove_has_its_hand_at_the_end_near_the_object() -> None:
    glove = arm_mask((285, 160), (215, 160), radius=20, half_width=14)
    (arm,) = find_arms(glove, OBJECT)
    np.testing.assert_allclose(arm.grip, [215 - 0.5 * 20, 160], atol=2)
    (turned,) = find_arms(glove, disc((310, 160), 8))
    assert turned.grip[0] > 275


def test_an_arm_along_the_border_is_as_wide_as_it_is_seen() -> None:
    (arm,) = find_arms(arm_mask((LAST, LAST - 4), (150, LAST - 4), radius=26, half_width=20), OBJECT)
    assert arm.radius == pytest.approx((26 + 4) / 2, abs=2)


def test_specks_are_no_arms() -> None:
    assert find_arms(disc((100, 100), 6), OBJECT) == []
    assert find_arms(np.zeros((SIDE, SIDE), bool), OBJECT) == []


def test_a_hand_is_near_when_it_could_touch_the_object() -> None:
    def near(x: int) -> bool:
        return is_near(find_arms(arm_mask((LAST, 160), (x, 160)), OBJECT)[0], OBJECT)

    assert near(215)
    assert near(150)
    assert not near(270)
    assert not is_near(find_arms(arm_mask((LAST, 160), (150, 160)), OBJECT)[0], np.zeros_like(OBJECT))
