"""Paths of hands in space from sights of them."""

from dataclasses import replace

import numpy as np

from egophys_core.perception.hands.hand_paths import contact_views, hand_paths
from egophys_core.perception.observation import HandSight
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_render import project
from tests.perception.surface.surface_scene import MATRIX, RATE, SIDE, camera_pose

VIEWS = [
    View(
        stamp_ns=round(frame / RATE * 1e9),
        image=np.zeros((SIDE, SIDE, 3), np.uint8),
        camera_matrix=MATRIX,
        world_from_camera=camera_pose(frame / RATE),
    )
    for frame in range(40)
]
CONTACT = 15
HALF_WIDTH = 0.037
"""Metres: of the hand that is seen; not a usual one."""
TRUE = np.column_stack([np.linspace(0.2, -0.02, 40), np.linspace(0.05, 0.11, 40), np.full(40, 0.04)])


OFFSET = np.array([0.02, -0.03, 0.01])
"""Metres: from the middle of the hand to where it holds."""


def sight(frame: int, *, contact: int | None = CONTACT) -> HandSight:
    """Of a hand on the true path whose depth is only known while it has contact."""
    view = VIEWS[frame]
    x, y, depth = project(TRUE[[frame]], view.camera_matrix, view.world_from_camera)[0]
    touches = contact is not None and frame >= contact
    return HandSight(
        pixel=np.array([x, y]),
        depth=depth if touches else 3.0,
        radius=MATRIX[0, 0] * HALF_WIDTH / depth,
        grip=TRUE[frame] + OFFSET if touches else np.full(3, np.nan),
        holds=touches,
    )


def test_before_contact_the_width_tells_the_depth() -> None:
    sights = [{0: sight(frame)} for frame in range(40)]
    path = hand_paths(sights, VIEWS)[0]
    assert path.shape == (40, 3)
    # Smoothing over a twentieth of a second is all that is lost; a wrong depth would be metres off.
    assert np.linalg.norm(path - TRUE - OFFSET, axis=1).max() < 0.004
    assert contact_views(sights) == {0: CONTACT}


def test_a_hidden_hand_goes_straight_from_where_it_was() -> None:
    hidden = range(20, 30)
    path = hand_paths([{} if frame in hidden else {0: sight(frame)} for frame in range(40)], VIEWS)[0]
    np.testing.assert_allclose(path[24:26].mean(axis=0), (path[19] + path[30]) / 2, atol=1e-9)
    assert np.linalg.norm(path - TRUE - OFFSET, axis=1).max() < 0.010
    # Before it is first seen it is where it appears.
    late = hand_paths([{} if frame < 10 else {0: sight(frame)} for frame in range(40)], VIEWS)[0]
    np.testing.assert_array_equal(late[:10], np.repeat(late[10:11], 10, axis=0))


def test_only_hands_that_ever_touch_have_paths() -> None:
    sights = [{0: sight(frame, contact=None), 1: sight(frame, contact=22)} for frame in range(40)]
    assert list(hand_paths(sights, VIEWS)) == [1]
    assert contact_views(sights) == {1: 22}
    nobody = [{0: sight(frame, contact=None)} for frame in range(40)]
    assert hand_paths(nobody, VIEWS) == {}
    assert contact_views(nobody) == {}


def test_a_width_that_jumps_for_one_view_is_left_out() -> None:
    sights = [{0: sight(frame)} for frame in range(40)]
    smooth = hand_paths(sights, VIEWS)[0]
    sights[28] = {0: replace(sights[28][0], radius=0.9 * sights[28][0].radius)}
    off = np.linalg.norm(hand_paths(sights, VIEWS)[0] - smooth, axis=1)
    assert off.max() < 0.003


def grown(sights: list[dict[int, HandSight]], views: list[int], factor: float) -> list[dict[int, HandSight]]:
    """The same, with a width that grows by a factor from one view to another."""
    by = np.interp(range(len(sights)), views, [1.0, factor])
    return [{0: replace(seen[0], radius=seen[0].radius * each)} for seen, each in zip(sights, by, strict=True)]


def test_an_outline_that_grows_faster_than_a_hand_comes_nearer_is_another_outline() -> None:
    sights = [{0: sight(frame)} for frame in range(40)]
    path, expected = hand_paths(grown(sights, [25, 29], 1.25), VIEWS)[0], hand_paths(sights, VIEWS)[0]
    assert np.linalg.norm(path - expected, axis=1).max() < 0.012


def test_a_hand_that_comes_nearer_fast_is_followed() -> None:
    sights = [{0: sight(frame)} for frame in range(40)]
    path, eye = hand_paths(grown(sights, [20, 35], 1.4), VIEWS)[0], VIEWS[-1].world_from_camera[:3, 3]
    before = np.linalg.norm(hand_paths(sights, VIEWS)[0][-1] - eye)
    assert np.linalg.norm(path[-1] - eye) < before / 1.35
