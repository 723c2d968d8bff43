"""Views to observations: what is left out, and when it begins."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.scene_observer import SceneObserver, board_outline
from egophys_core.perception.stages import HandLandmarks, View
from tests.perception.hands.drawn_hand import pinching_hand, seen_hand
from tests.perception.surface.surface_scene import MATRIX, OPTIONS, SIDE, DrawnFrame, video

VIEWS = [each.view for each in video()[:16]]
UNKNOWN = np.full((4, 4), np.nan)


def test_begins_after_the_still_time_with_all_views_in_order() -> None:
    scene = SceneObserver(OPTIONS, Board())
    found = [scene.add(view) for view in VIEWS]
    counts = [len(each) for each in found]
    begun = next(index for index, count in enumerate(counts) if count)
    assert (VIEWS[begun].stamp_ns - VIEWS[0].stamp_ns) * 1e-9 >= OPTIONS.still_s
    assert counts[begun] == begun + 1
    assert set(counts[begun + 1 :]) == {1}
    assert [one.view.stamp_ns for each in found for one in each] == [view.stamp_ns for view in VIEWS]
    assert scene.finish() == []
    assert scene.rest is not None
    assert scene.warning == ""


def test_black_views_and_those_without_a_pose_are_left_out() -> None:
    scene = SceneObserver(OPTIONS, Board())
    black = replace(VIEWS[2], image=np.zeros((SIDE, SIDE, 3), np.uint8))
    lost = replace(VIEWS[3], world_from_camera=UNKNOWN)
    assert not any(scene.add(view) for view in [*VIEWS[:2], black, lost, *VIEWS[4:8]])
    stamps = [each.view.stamp_ns for each in scene.finish()]
    assert stamps == [view.stamp_ns for view in [*VIEWS[:2], *VIEWS[4:8]]]


def test_a_short_video_begins_at_its_end() -> None:
    scene = SceneObserver(OPTIONS, Board())
    assert [scene.add(view) for view in VIEWS[:8]] == [[]] * 8
    assert len(scene.finish()) == 8


@pytest.mark.parametrize("count", [0, 1, 4])
def test_too_few_views_are_an_error(count: int) -> None:
    scene = SceneObserver(OPTIONS, Board())
    for view in VIEWS[:count]:
        scene.add(view)
    with pytest.raises(EpisodeError, match=f"{count} views"):
        scene.finish()


def test_points_out_of_the_depth_range_are_not_trusted() -> None:
    scene = SceneObserver(replace(OPTIONS, nearest_m=0.2, farthest_m=0.3), Board())
    assert not any(scene.add(view) for view in VIEWS[:6])
    found = scene.finish()
    assert max(each.confidence.max() for each in found) == 0


class HandAtMask:
    """A `HandLandmarker` that puts a hand half a metre away on the true mask of the hand, if there is one."""

    def __init__(self, frames: list[DrawnFrame]) -> None:
        self.masks = {each.stamp_ns: each.masks.hand for each in frames}
        self.found: dict[int, HandLandmarks] = {}

    def hands(self, view: View) -> list[HandLandmarks]:
        rows, columns = np.nonzero(self.masks[view.stamp_ns])
        self.found[view.stamp_ns] = seen_hand(pinching_hand(), (columns.mean(), rows.mean()), 0.5, matrix=MATRIX)
        return [self.found[view.stamp_ns]]


def test_landmarks_tell_where_hands_are() -> None:
    frames = list(video()[9:21])
    landmarker = HandAtMask(frames)
    scene = SceneObserver(replace(OPTIONS, still_s=0.13), Board(), landmarker=landmarker)
    found = [one for frame in frames for one in scene.add(frame.view)]
    handled = [each for each in found if each.hands]
    assert len(handled) > 2
    assert set(landmarker.found) == {each.view.stamp_ns for each in handled}
    for each in handled:
        (sight,) = each.hands.values()
        hand = landmarker.found[each.view.stamp_ns]
        np.testing.assert_allclose(sight.pixel, hand.pixels[[4, 8]].mean(axis=0))
    sight = handled[0].hands[0]
    assert not sight.has_contact
    assert sight.depth == pytest.approx(0.47, abs=0.03)


def test_the_sheet_of_the_board_is_a_gap_wider_than_its_tags() -> None:
    outline = board_outline(Board())
    np.testing.assert_allclose(outline[:, 2], 0.001)
    assert np.ptp(outline[:, 0]) == pytest.approx(0.285 + 0.03)
    assert np.ptp(outline[:, 1]) == pytest.approx(0.21 + 0.03)
