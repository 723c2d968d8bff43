"""Hands from view to view: which is which, and each with its outline."""

import numpy as np
import pytest

from egophys_core.perception.hands.hand_tracks import HandTracks
from tests.perception.hands.arm_drawing import SIDE, arm_mask, disc, together
from tests.perception.hands.drawn_outline import picture

OBJECT, LAST = disc((160, 160), 50), SIDE - 1
BLANK = np.full((SIDE, SIDE, 3), 128, np.uint8)
"""A view in which no outline is seen: only masks tell where hands are."""


def left(shift: int = 0) -> np.ndarray:
    return arm_mask((0, 200), (110 + shift, 160 + shift))


def right(shift: int = 0) -> np.ndarray:
    return arm_mask((LAST, 200), (215 - shift, 160 + shift))


def test_hands_keep_their_numbers_while_they_move_and_hide() -> None:
    tracks = HandTracks()
    (first,) = tracks.next(BLANK, right(), OBJECT)
    for view in range(1, 12):
        is_hidden = 4 <= view < 8
        shown = together([left(2 * view), *([] if is_hidden else [right(2 * view)])])
        found = tracks.next(BLANK, shown, OBJECT)
        assert len(found) == (1 if is_hidden else 2)
        for number, arm in found.items():
            assert (arm.centre[0] > SIDE / 2) == (number == first)


def test_hands_side_by_side_are_not_mistaken_for_each_other() -> None:
    def shown(y: int) -> np.ndarray:
        return arm_mask((LAST, y), (200, y), radius=14, half_width=9)

    tracks = HandTracks()
    assert list(tracks.next(BLANK, shown(190), OBJECT)) == [0]
    for shift in (0, 8, 16):
        found = tracks.next(BLANK, together([shown(150 + shift), shown(190 + shift)]), OBJECT)
        assert found[0].centre[1] == pytest.approx(190 + shift, abs=2)
        assert found[1].centre[1] == pytest.approx(150 + shift, abs=2)


def test_a_third_hand_is_not_taken() -> None:
    tracks = HandTracks()
    assert len(tracks.next(BLANK, together([left(), right()]), OBJECT)) == 2
    third = arm_mask((160, 0), (160, 120))
    found = tracks.next(BLANK, together([left(), right(), third]), OBJECT)
    assert len(found) == 2
    assert all(arm.centre[1] > 140 for arm in found.values())


def test_a_hand_does_not_jump_across_the_view() -> None:
    tracks = HandTracks()
    tracks.next(BLANK, together([left(), right()]), OBJECT)
    assert tracks.next(BLANK, arm_mask((160, 0), (160, 70)), OBJECT) == {}
    assert set(tracks.next(BLANK, together([left(), right()]), OBJECT)) == {0, 1}


def test_what_never_comes_near_the_object_is_no_hand() -> None:
    tracks, clutter = HandTracks(), arm_mask((LAST, 20), (270, 20))
    for view in range(5):
        assert tracks.next(BLANK, clutter, OBJECT) == {}
        assert list(tracks.next(BLANK, together([clutter, left(view)]), OBJECT)) == [0]


def test_a_hand_that_has_been_at_the_object_is_followed_away_from_it() -> None:
    tracks = HandTracks()
    for shift in (0, 30, 60, 90):
        found = tracks.next(BLANK, arm_mask((LAST, 160), (200 + shift, 160)), OBJECT)
    assert list(found) == [0]
    assert found[0].centre[0] > 280


def test_hands_with_outlines_are_followed_where_masks_fail() -> None:
    tracks = HandTracks()
    first = picture((110.0, 160.0), (28.0, 26.0), arm_to=(-20.0, 200.0))
    assert list(tracks.next(first, left(), OBJECT)) == [0]
    for view in range(1, 5):
        place = (110.0 + 4 * view, 160.0)
        found = tracks.next(picture(place, (28.0, 26.0), arm_to=(-20.0, 200.0), seed=view), ~OBJECT & False, OBJECT)
        np.testing.assert_allclose(found[0].centre, place, atol=1.0)
        assert found[0].mask[160, 110 + 4 * view]


def test_two_hands_never_share_an_outline() -> None:
    tracks = HandTracks()
    image = picture((110.0, 160.0), (28.0, 26.0), arm_to=(-20.0, 200.0))
    tracks.next(image, left(), OBJECT)
    # A second arm whose end lies over the first hand has no outline of its own.
    found = tracks.next(image, together([left(), arm_mask((160, LAST), (135, 185))]), OBJECT)
    outlines = [arm.outline for arm in found.values() if arm.outline is not None]
    assert len(outlines) == 1
