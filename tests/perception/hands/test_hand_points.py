"""Points of the hand in space, from the moment it takes hold."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.perception.hands.hand_points import HandPoints, at_depth
from egophys_core.perception.surface.surface_render import project
from tests.perception.surface.surface_scene import object_at_rest, tracked, video

FRAMES = video()[object_at_rest().reference + 1 :]
COUNT = 12


def paths() -> np.ndarray:
    hand = HandPoints(COUNT)
    return np.array([hand.next(each.view, each.masks, state) for each, state in zip(FRAMES, tracked(), strict=True)])


def grip_index() -> int:
    return next(index for index, state in enumerate(tracked()) if state.grip is not None)


def test_nothing_before_the_grip_and_points_from_then_on() -> None:
    found = paths()
    assert found.shape == (len(FRAMES), COUNT, 3)
    assert np.isnan(found[: grip_index()]).all()
    assert np.isfinite(found[grip_index() :]).all()


def test_points_lie_on_the_hand_in_the_image_and_near_it_in_space() -> None:
    index = grip_index()
    frame, found = FRAMES[index], paths()[index]
    x, y = np.rint(project(found, frame.view.camera_matrix, frame.world_from_camera)[:, :2]).astype(int).T
    assert frame.masks.hand[y, x].all()
    # The drawn hand touches the right end of the sheet, a radius of 14 mm above it.
    held = tracked()[index].grip
    assert held is not None
    place = tracked()[index].positions[held.vertices].mean(axis=0)
    assert np.linalg.norm(found - place, axis=1).max() < 0.06


def test_they_move_with_what_is_held() -> None:
    index, found = grip_index(), paths()
    way = np.linalg.norm(found[-1].mean(axis=0) - found[index].mean(axis=0))
    grip = tracked()[index].grip
    assert grip is not None
    true = np.linalg.norm((tracked()[-1].positions - tracked()[index].positions)[grip.vertices].mean(axis=0))
    assert way == pytest.approx(true, rel=0.5)
    assert way > 0.02


def test_a_hand_that_is_not_seen_has_no_place() -> None:
    hand, index = HandPoints(COUNT), grip_index()
    hand.next(FRAMES[index].view, FRAMES[index].masks, tracked()[index])
    gone = replace(tracked()[index + 1], hand_motion=None, grip=None)
    assert np.isnan(hand.next(FRAMES[index + 1].view, FRAMES[index + 1].masks, gone)).all()


def test_pixels_at_a_depth_project_back() -> None:
    view, pixels = FRAMES[0].view, np.array([[10.0, 20], [160, 300]])
    found = project(at_depth(pixels, 0.4, view), view.camera_matrix, view.world_from_camera)
    np.testing.assert_allclose(found, np.column_stack([pixels, [0.4, 0.4]]))
