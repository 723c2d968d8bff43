"""The outline of a hand from view to view."""

import numpy as np
import pytest

from egophys_core.perception.hands.arms import SeenArm
from egophys_core.perception.hands.hand_likeness import HandLikeness
from egophys_core.perception.hands.hand_outline import HandOutline
from egophys_core.perception.hands.outline_follower import OutlineFollower
from tests.perception.hands.drawn_outline import SIDE, coverage, picture

WIDTHS = (32.0, 28.0)


def seen_arm(centre: tuple[float, float]) -> SeenArm:
    mask = coverage(centre, WIDTHS) > 0.5
    middle = np.array(centre)
    return SeenArm(mask=mask, centre=middle + [3, 2], grip=middle - [10, 0], radius=26.0)


def begun(centre: tuple[float, float]) -> OutlineFollower:
    follower = OutlineFollower()
    arm = seen_arm(centre)
    assert follower.find(picture(centre, WIDTHS), arm.mask, arm) is not None
    return follower


def test_a_hand_is_followed_without_a_mask() -> None:
    follower, nothing = begun((100.0, 160.0)), np.zeros((SIDE, SIDE), bool)
    for view in range(1, 10):
        scale = 1 - 0.01 * view
        place, widths = (100.0 + 5 * view, 160.0 - 2 * view), (WIDTHS[0] * scale, WIDTHS[1] * scale)
        found = follower.follow(picture(place, widths, arm_to=(330.0, 200.0), seed=view), nothing)
        assert found is not None
        np.testing.assert_allclose(found.centre, place, atol=0.7)
        assert found.half_widths[0] == pytest.approx(widths[1], rel=0.03)


def test_a_hand_that_is_gone_is_lost_and_found_by_its_arm() -> None:
    follower = begun((100.0, 160.0))
    empty, nothing = picture((-200.0, -200.0), WIDTHS, seed=3), np.zeros((SIDE, SIDE), bool)
    assert follower.follow(empty, nothing) is None
    assert follower.follow(empty, nothing) is None
    arm = seen_arm((220.0, 120.0))
    image = picture((220.0, 120.0), WIDTHS, seed=4)
    tries = [follower.find(image, arm.mask, arm) for _ in range(3)]
    found = [each for each in tries if each is not None]
    assert found
    np.testing.assert_allclose(found[0].centre, (220.0, 120.0), atol=0.5)


def test_a_hand_that_leaves_the_view_is_lost() -> None:
    follower = begun((40.0, 160.0))
    nothing = np.zeros((SIDE, SIDE), bool)
    places = [(40.0 - 12 * view, 160.0) for view in range(1, 9)]
    last = [follower.follow(picture(place, WIDTHS, seed=7), nothing) for place in places][-1]
    assert last is None


def test_nothing_is_followed_before_anything_was_found() -> None:
    assert OutlineFollower().follow(picture((100.0, 100.0), WIDTHS), np.zeros((SIDE, SIDE), bool)) is None


def test_likeness_tells_a_hand_from_a_table_of_its_brightness() -> None:
    likeness, place = HandLikeness(), (150.0, 150.0)
    image = picture(place, WIDTHS, skin=(148.0, 156.0, 160.0))
    assert not likeness.known
    outline = HandOutline(centre=np.array(place), form=np.diag(1 / np.array(WIDTHS) ** 2), support=1.0)
    likeness.learn(image, outline, np.zeros((SIDE, SIDE), bool))
    assert likeness.known
    there = (170.0, 140.0)
    found = likeness.of(picture(there, WIDTHS, skin=(148.0, 156.0, 160.0), seed=1))
    inside = coverage(there, (22.0, 18.0)) > 0.5
    around = (coverage(there, (60.0, 60.0)) > 0.5) & ~(coverage(there, (40.0, 40.0)) > 0.5)
    assert np.median(found[inside]) > 0.8
    assert np.median(found[around]) < 0.2
