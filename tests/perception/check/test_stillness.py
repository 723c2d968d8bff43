import numpy as np
import pytest

from egophys_core.perception.check.stillness import Stillness, depth_error_m, stillness
from tests.perception.table_scene import Scene, camera_pose, draw

STEP = 3


def looked_at(scene: Scene, frames: range) -> Stillness:
    views, masks = zip(*(draw(scene, frame) for frame in frames), strict=True)
    return stillness(views, masks[0].object)


def test_an_object_at_rest_is_told_from_one_that_moves_by_millimetres():
    resting = looked_at(Scene(hand_frames=None), range(0, 31, STEP))
    assert resting.points > 50
    assert np.nanmax(resting.residual_px) < 0.4
    assert resting.rests(0.8) == (0.0, pytest.approx(1.0))
    # Pushed from frame 12 on, 1 mm a frame: in a third of a second by a centimetre.
    pushed = looked_at(Scene(hand_frames=(0, 0), push=(0.001, 0.0)), range(0, 31, STEP))
    assert np.nanmax(pushed.residual_px) > 1.5
    begin, lasts = pushed.rests(0.8)
    assert (begin, lasts) == (0.0, pytest.approx(0.45, abs=0.16))


def test_an_object_that_settles_rests_from_then_on():
    times = np.arange(8) * 0.1
    still = Stillness(times=times, residual_px=np.array([3, 2, 0.2, np.nan, 0.1, 0.2, 0.2, 2]), points=9)
    assert still.rests(0.8) == (pytest.approx(0.2), pytest.approx(0.4))
    assert Stillness(times=times, residual_px=np.full(8, 5.0), points=9).rests(0.8) == (0.0, 0.0)


def test_depth_is_uncertain_by_the_place_of_a_point_over_the_way_of_the_camera():
    views = [draw(Scene(hand_frames=None), frame)[0] for frame in (0, 15, 30)]
    aside, error = depth_error_m(views, np.array([0.0, 0.06, 0.0]), pixel_sigma=0.3)
    left, _, right = (camera_pose(frame)[:3, 3] for frame in (0, 30, 15))
    assert aside == pytest.approx(np.linalg.norm(right - left), rel=0.15)
    # Three views that spread by 24 mm about their mean, 0.7 m away, of a lens of 460 pixels.
    assert error == pytest.approx(0.7**2 / 460 * 0.3 / 0.024 / np.sqrt(3), rel=0.3)
    assert depth_error_m(views[:1] * 3, np.array([0.0, 0.06, 0.0]))[1] > 1.0
