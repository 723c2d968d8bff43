"""The surface from view to view, with true poses and masks."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.perception.hands.hand_tracks import HandTracks
from egophys_core.perception.stages import Masks
from egophys_core.perception.surface.surface_render import project
from egophys_core.perception.surface.surface_tracker import SurfaceState, SurfaceTracker
from tests.perception.surface.surface_scene import SIDE, material_of, object_at_rest, surface, tracked, video

REST, FRAMES = object_at_rest(), video()
NOTHING = Masks(object=np.zeros((SIDE, SIDE), bool), hand=np.zeros((SIDE, SIDE), bool))
INNER = REST.model.mesh.triangles[REST.feature_triangles]

HELD = 16 * 33 + 31
"""Of the 33 by 33 drawn points: the middle of the right end."""


def states() -> list[tuple[int, SurfaceState]]:
    """Index of the frame and state, of every frame after the reference."""
    return list(enumerate(tracked(), REST.reference + 1))


def points(positions: np.ndarray) -> np.ndarray:
    return np.einsum("nk,nkd->nd", REST.feature_weights, positions[INNER])


def error(index: int) -> np.ndarray:
    """[N] metres from the drawn material, of the features seen in the state before frame index."""
    first = FRAMES[REST.reference]
    material = material_of(points(REST.model.rest), first)
    state = tracked()[index - REST.reference - 1]
    true = surface(FRAMES[index])[material]
    return np.asarray(np.linalg.norm(points(state.positions) - true, axis=1)[state.seen])


@pytest.mark.parametrize("index", [6, 14, 24, 34, 44])
def test_material_is_followed(index: int) -> None:
    found = error(index)
    assert len(found) > 0.5 * len(REST.feature_pixels)
    # Half the thickness of 3 mm lies between skin and middle.
    assert found.mean() < 0.0035
    assert np.percentile(found, 95) < 0.010


def test_hand_takes_hold_when_the_object_moves_and_not_before() -> None:
    touching = [index for index, state in states() if any(hand.has_contact for hand in state.hands.values())]
    assert 18 <= touching[0] <= 28
    assert touching == list(range(touching[0], len(FRAMES)))


def test_hand_is_where_it_holds() -> None:
    misses = []
    for index, state in states():
        frame = FRAMES[index]
        # The drawn hand touches the middle of the right end.
        held = project(frame.points[[HELD]], frame.view.camera_matrix, frame.world_from_camera)[0]
        for hand in state.hands.values():
            if hand.has_contact:
                misses.append(np.abs([*(hand.pixel - held[:2]), hand.depth - held[2]]))
    assert len(misses) > 15
    # 10 pixels are 16 mm there, about the radius of the drawn hand.
    assert np.max(misses, axis=0) == pytest.approx([0, 0, 0], abs=10)
    # By its width alone: a pixel of the 17 that the drawn hand is wide are 35 mm.
    assert max(miss[2] for miss in misses) < 0.045


def test_a_solid_is_pushed_from_where_it_begins_to_move() -> None:
    frames, reference = video("dome"), object_at_rest("dome").reference
    pushing = []
    for frame, state in zip(frames[reference + 1 :], tracked("dome"), strict=True):
        for hand in state.hands.values():
            if hand.has_contact:
                # The drawn hand comes to the right side of the dome, and its tip is 14 mm above.
                touched = frame.points[[16 * 33 + 29]] + [0, 0, 0.014]
                x, y, depth = project(touched, frame.view.camera_matrix, frame.world_from_camera)[0]
                np.testing.assert_allclose(hand.pixel, [x, y], atol=10)
                # By its width alone: a pixel of the 17 that the drawn hand is wide are 35 mm, and at the rim of the
                # dome, where it learns its width, a pixel along the image are 15 mm in depth.
                assert hand.depth == pytest.approx(depth, abs=0.055)
                pushing.append(frame)
    assert frames.index(pushing[0]) <= 22
    assert len(pushing) == len(frames) - frames.index(pushing[0])


def test_hands_are_those_that_are_seen() -> None:
    for index, state in states():
        assert len(state.hands) <= 1
        if not FRAMES[index].masks.hand.any():
            assert not state.hands
    assert len(tracked()[-1].hands) == 1


def test_a_hand_that_is_hidden_for_a_while_goes_on_holding() -> None:
    last, hidden = 32, range(24, 29)
    tracker, hands = SurfaceTracker(REST, FRAMES[REST.reference].view), HandTracks()
    # Nothing happens before the hand comes.
    for index in range(15, last + 1):
        frame = FRAMES[index]
        arms = hands.next(frame.masks.hand & (index not in hidden), tracker.silhouette(frame.view))
        state = tracker.next(frame.view, frame.masks, arms)
        assert index not in hidden or not state.hands
    (hand,), (never_hidden,) = state.hands.values(), dict(states())[last].hands.values()
    assert hand.has_contact
    np.testing.assert_allclose(hand.pixel, never_hidden.pixel, atol=6)
    assert hand.depth == pytest.approx(never_hidden.depth, abs=0.01)


def test_lengths_are_kept() -> None:
    one, other = REST.model.mesh.edges.T
    length = np.linalg.norm(tracked()[-1].positions[one] - tracked()[-1].positions[other], axis=1)
    strain = length / np.linalg.norm(REST.model.rest[one] - REST.model.rest[other], axis=1) - 1
    assert np.abs(strain).mean() < 0.02


def test_what_is_not_seen_stays_with_the_prediction() -> None:
    tracker = SurfaceTracker(REST, FRAMES[REST.reference].view)
    for frame in FRAMES[1:8]:
        state = tracker.next(frame.view, NOTHING, {})
    assert not state.seen.any()
    assert not state.hands
    # On the table it can not fall.
    np.testing.assert_allclose(state.positions, REST.model.rest, atol=0.002)


def test_found_again_after_it_was_hidden() -> None:
    tracker = SurfaceTracker(REST, FRAMES[REST.reference].view)
    for index, frame in enumerate(FRAMES[1:13]):
        state = tracker.next(frame.view, NOTHING if 3 <= index < 9 else frame.masks, {})
    assert state.seen.mean() > 0.7


def test_backward_in_time_works_as_forward() -> None:
    tracker = SurfaceTracker(REST, FRAMES[REST.reference].view)
    for frame in reversed(FRAMES[:12]):
        state = tracker.next(frame.view, frame.masks, {})
    assert state.seen.mean() > 0.7
    assert np.isfinite(state.positions).all()


def test_repeated_stamp_does_no_harm() -> None:
    tracker = SurfaceTracker(REST, FRAMES[REST.reference].view)
    for _ in range(3):
        state = tracker.next(replace(FRAMES[1].view, stamp_ns=FRAMES[0].stamp_ns), FRAMES[1].masks, {})
    assert np.isfinite(state.positions).all()


@pytest.mark.parametrize("value", [0, 255])
def test_black_and_white_images_see_nothing_and_stay_finite(value: int) -> None:
    tracker = SurfaceTracker(REST, FRAMES[REST.reference].view)
    plain = np.full((SIDE, SIDE, 3), value, np.uint8)
    state = tracker.next(replace(FRAMES[1].view, image=plain), FRAMES[1].masks, {})
    assert state.seen.mean() < 0.05
    assert np.isfinite(state.positions).all()


def test_camera_that_looks_away_sees_nothing_and_stays_finite() -> None:
    pose = FRAMES[1].world_from_camera @ np.diag([1.0, -1, -1, 1])
    state = SurfaceTracker(REST, FRAMES[0].view).next(
        replace(FRAMES[1].view, world_from_camera=pose), FRAMES[1].masks, {}
    )
    assert not state.seen.any()
    assert np.isfinite(state.positions).all()
