"""Where a hand acts on the object when that begins to move, and how deep in the view a hand is by its width."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.perception.hands.arms import SeenArm, SizeCue, find_arms
from egophys_core.perception.hands.grip import USUAL_HALF_WIDTH_M, HandGrip, covered_share, depth_by_width, take_grip
from egophys_core.perception.hands.hand_points import at_depth
from egophys_core.perception.hands.landmark_depth import LandmarkGrip
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_render import project
from tests.perception.hands.arm_drawing import SIDE, arm_mask, disc

FOCAL = 300.0
MATRIX = np.array([[FOCAL, 0, SIDE / 2], [0, FOCAL, SIDE / 2], [0, 0, 1]])
VIEW = View(
    stamp_ns=0, image=np.zeros((SIDE, SIDE, 3), np.uint8), camera_matrix=MATRIX, world_from_camera=np.eye(4)
)  # fmt: skip
OBJECT = disc((110, 160), 70)
DEPTH = 0.5


def arm_at(x: int = 190, y: int = 160) -> SeenArm:
    return find_arms(arm_mask((SIDE - 1, 160), (x, y)), OBJECT)[0]


def vertices() -> np.ndarray:
    """[V, 3] pixels and depth, half a metre away, 5 pixels apart."""
    grid = np.stack(np.meshgrid(np.arange(40, 181, 5.0), np.arange(100, 221, 5.0)), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.full(len(grid), DEPTH)])


def grip_of(arm: SeenArm, places: np.ndarray | None = None, *, is_solid: bool = False) -> HandGrip:
    """Of a hand at the object, whose vertices are at some pixels and depths."""
    places = vertices() if places is None else places
    positions = np.vstack([at_depth(place[None, :2], place[2], VIEW) for place in places])
    holds = covered_share(arm, OBJECT) > 0.12
    return take_grip(arm, OBJECT, positions, places, VIEW, holds=holds, is_solid=is_solid)


def held_at(grip: HandGrip, arm: SeenArm) -> np.ndarray:
    """[3] pixel and depth of where a hand holds when it is where its grip was taken."""
    middle = at_depth(arm.centre[None], depth_by_width(grip.half_width, arm, VIEW), VIEW)
    return project(middle + grip.offset, MATRIX, np.eye(4))[0]


def test_a_hand_holds_the_middle_of_what_it_covers_as_deep_as_that_is() -> None:
    arm = arm_at(160)
    # The object ends at x = 180; the hand's disc of 26 pixels begins at 134.
    assert held_at(grip_of(arm), arm) == pytest.approx([(134 + 180) / 2, 160, DEPTH], abs=2)
    assert held_at(grip_of(arm), arm)[2] == pytest.approx(DEPTH, abs=0.01)


def test_a_hand_at_the_rim_of_a_solid_holds_it_nearer_to_that() -> None:
    rim = arm_at(185)
    covered, tip = held_at(grip_of(rim), rim)[:2], rim.grip
    held = held_at(grip_of(rim, is_solid=True), rim)[:2]
    assert covered[0] + 1 < held[0] < tip[0]
    whole = arm_at(110)
    np.testing.assert_allclose(
        held_at(grip_of(whole, is_solid=True), whole)[:2], held_at(grip_of(whole), whole)[:2], atol=1e-6
    )


def test_a_hand_of_another_width_than_usual_is_as_deep_as_what_it_covers() -> None:
    arm = arm_at(160)
    small = replace(arm, radius=0.4 * arm.radius)
    assert held_at(grip_of(small), small)[2] == pytest.approx(DEPTH, abs=0.01)


def test_a_hand_over_the_object_covers_it_and_one_beside_it_does_not() -> None:
    # Of the disc of the hand, 26 pixels of radius, and of its arm.
    assert covered_share(arm_at(100), OBJECT) > 1.0
    assert 0.2 < covered_share(arm_at(180), OBJECT) < 0.8
    assert covered_share(arm_at(230), OBJECT) == 0.0


def test_what_is_held_is_near_the_grip() -> None:
    grip = grip_of(arm_at(160))
    assert grip.holds
    assert len(grip.vertices) >= 3
    assert np.linalg.norm(grip.beside, axis=1).max() < 0.02


def test_a_hand_that_hardly_covers_the_object_holds_ahead_of_its_middle() -> None:
    arm = arm_at(210)
    assert arm.grip[0] < arm.centre[0]
    grip = grip_of(arm)
    np.testing.assert_allclose(held_at(grip, arm)[:2], arm.grip, atol=1e-6)
    assert held_at(grip, arm)[2] == pytest.approx(DEPTH, abs=0.06)
    assert not grip.holds
    assert len(grip.vertices) == 0


def test_landmarks_tell_the_place_where_they_are_found() -> None:
    place = np.array([130.0, 150])
    arm = replace(arm_at(160), grip=place, landmarks=LandmarkGrip(pixel=place, depth=DEPTH, sigma=0.03))
    grip = grip_of(arm)
    np.testing.assert_allclose(held_at(grip, arm)[:2], place, atol=1e-6)
    assert grip.cue == SizeCue.LANDMARKS


def test_a_hand_that_pushes_touches_the_object_as_deep_as_its_width_says() -> None:
    arm = arm_at(210)
    usual = depth_by_width(USUAL_HALF_WIDTH_M, arm, VIEW) + 0.06
    # A face along the line of sight, 25 mm beside where the hand pushes: it may touch it anywhere.
    beside = (arm.grip - [0.025 * FOCAL / usual, 0.0])[None]
    along = np.vstack([at_depth(beside, depth, VIEW) for depth in np.linspace(usual - 0.1, usual + 0.1, 60)])
    face = project(along, MATRIX, np.eye(4))
    assert held_at(grip_of(arm, face), arm)[2] == pytest.approx(usual, abs=0.01)
    # Only its far end is there: the hand is near that.
    far = face[face[:, 2] > usual + 0.05]
    assert usual + 0.015 < held_at(grip_of(arm, far), arm)[2] < usual + 0.08


def test_a_hand_is_as_wide_as_hands_are_unless_it_were_far_from_what_it_holds() -> None:
    arm, places = arm_at(160), vertices()
    for depth in (0.2, 3.0):
        places[:, 2] = depth
        grip = grip_of(arm, places)
        middle = depth_by_width(grip.half_width, arm, VIEW)
        holding = held_at(grip, arm)[2]
        # Not behind what it holds, nor farther before it than it is wide.
        assert holding - 0.1 < middle <= holding + 1e-9


def test_the_place_goes_along_with_the_hand() -> None:
    arm = arm_at()
    grip = grip_of(arm)
    nearer = replace(arm, radius=1.25 * arm.radius)
    assert depth_by_width(grip.half_width, nearer, VIEW) == pytest.approx(
        0.8 * depth_by_width(grip.half_width, arm, VIEW)
    )
