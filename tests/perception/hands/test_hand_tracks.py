"""Hands from view to view: which is which, and how deep by their width."""

import numpy as np
import pytest

from egophys_core.perception.hands.arms import SeenArm, find_arms
from egophys_core.perception.hands.hand_tracks import HandTracks, HandWidth
from tests.perception.hands.arm_drawing import SIDE, arm_mask, disc, together

OBJECT, LAST = disc((160, 160), 50), SIDE - 1
FOCAL = 400.0


def left(shift: int = 0) -> np.ndarray:
    return arm_mask((0, 200), (110 + shift, 160 + shift))


def right(shift: int = 0) -> np.ndarray:
    return arm_mask((LAST, 200), (215 - shift, 160 + shift))


def test_hands_keep_their_numbers_while_they_move_and_hide() -> None:
    tracks = HandTracks()
    (first,) = tracks.next(right(), OBJECT)
    for view in range(1, 12):
        is_hidden = 4 <= view < 8
        shown = together([left(2 * view), *([] if is_hidden else [right(2 * view)])])
        found = tracks.next(shown, OBJECT)
        assert len(found) == (1 if is_hidden else 2)
        for number, arm in found.items():
            assert (arm.centre[0] > SIDE / 2) == (number == first)


def test_hands_side_by_side_are_not_mistaken_for_each_other() -> None:
    def shown(y: int) -> np.ndarray:
        return arm_mask((LAST, y), (200, y), radius=14, half_width=9)

    tracks = HandTracks()
    assert list(tracks.next(shown(190), OBJECT)) == [0]
    for shift in (0, 8, 16):
        found = tracks.next(together([shown(150 + shift), shown(190 + shift)]), OBJECT)
        assert found[0].centre[1] == pytest.approx(190 + shift, abs=2)
        assert found[1].centre[1] == pytest.approx(150 + shift, abs=2)


def test_a_third_hand_is_not_taken() -> None:
    tracks = HandTracks()
    assert len(tracks.next(together([left(), right()]), OBJECT)) == 2
    third = arm_mask((160, 0), (160, 120))
    found = tracks.next(together([left(), right(), third]), OBJECT)
    assert len(found) == 2
    assert all(arm.centre[1] > 140 for arm in found.values())


def test_a_hand_does_not_jump_across_the_view() -> None:
    tracks = HandTracks()
    tracks.next(together([left(), right()]), OBJECT)
    assert tracks.next(arm_mask((160, 0), (160, 70)), OBJECT) == {}
    assert set(tracks.next(together([left(), right()]), OBJECT)) == {0, 1}


def test_what_never_comes_near_the_object_is_no_hand() -> None:
    tracks, clutter = HandTracks(), arm_mask((LAST, 20), (270, 20))
    for view in range(5):
        assert tracks.next(clutter, OBJECT) == {}
        assert list(tracks.next(together([clutter, left(view)]), OBJECT)) == [0]


def test_a_hand_that_has_been_at_the_object_is_followed_away_from_it() -> None:
    tracks = HandTracks()
    for shift in (0, 30, 60, 90):
        found = tracks.next(arm_mask((LAST, 160), (200 + shift, 160)), OBJECT)
    assert list(found) == [0]
    assert found[0].centre[0] > 280


def arm_of_radius(radius: int) -> SeenArm:
    return find_arms(arm_mask((LAST, 160), (200, 160), radius=radius, half_width=14), OBJECT)[0]


def test_width_tells_the_depth_of_a_usual_hand_before_anything_is_learnt() -> None:
    width = HandWidth()
    assert np.isnan(width.depth(FOCAL))
    width.see(arm_of_radius(30))
    # A closed hand is 7 to 10 cm wide: 30 pixels of 400 are half of that at half a metre or so.
    assert 0.035 * FOCAL / 32 < width.depth(FOCAL) < 0.050 * FOCAL / 28


def test_learnt_width_tells_the_depth() -> None:
    width = HandWidth()
    width.see(arm_of_radius(30))
    width.learn(0.6, FOCAL)
    assert width.depth(FOCAL) == pytest.approx(0.6)
    for _ in range(20):
        width.see(arm_of_radius(20))
    # To a pixel in twenty.
    assert width.depth(FOCAL) == pytest.approx(0.9, rel=0.05)


def test_one_wrong_outline_does_not_change_the_depth() -> None:
    width = HandWidth()
    for radius in (30, 30, 30, 15, 30):
        width.see(arm_of_radius(radius))
    width.learn(0.5, FOCAL)
    before = width.depth(FOCAL)
    width.see(arm_of_radius(40))
    assert width.depth(FOCAL) == pytest.approx(before)
