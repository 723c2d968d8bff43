import numpy as np
import pytest

from egophys_core.perception.check.hands_seen import hands_seen
from egophys_core.perception.stages import Masks

SIDE = 200
TIMES = np.arange(6) * 0.2


def masks(*hands: tuple[slice, slice]) -> Masks:
    thing, hand = np.zeros((SIDE, SIDE), bool), np.zeros((SIDE, SIDE), bool)
    thing[90:130, 80:120] = True
    for rows, columns in hands:
        hand[rows, columns] = True
    return Masks(object=thing & ~hand, hand=hand)


def arm(tip: int) -> tuple[slice, slice]:
    """From the right border to a column."""
    return slice(100, 120), slice(tip, SIDE)


CLUTTER = (slice(0, 40), slice(0, 40))


def test_a_hand_counts_from_where_it_comes_into_view():
    seen = hands_seen(TIMES, (masks(), masks(arm(180)), masks(arm(150)), masks(arm(110)), masks(arm(110)), masks()))
    assert seen.count == 1
    assert seen.first_s == pytest.approx(0.2)
    assert seen.areas == pytest.approx(np.array([0, 20, 50, 90, 90, 0]) * 20 / SIDE**2)


def test_things_that_lie_about_are_no_hands_and_two_hands_are_two():
    left = (slice(100, 120), slice(0, 90))
    assert hands_seen(TIMES, tuple(masks(CLUTTER) for _ in TIMES)).count == 0
    assert hands_seen(TIMES, tuple(masks(CLUTTER, arm(110)) for _ in TIMES)).count == 1
    two = hands_seen(TIMES, tuple(masks(arm(110), left) for _ in TIMES))
    assert (two.count, two.first_s) == (2, 0.0)
    assert np.isnan(hands_seen(TIMES, (masks(), masks(), masks(arm(110)), masks(), masks(), masks())).first_s)
