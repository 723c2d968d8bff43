"""When hands have contact, and what is known of them then."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.perception.hands.arms import SeenArm, find_arms
from egophys_core.perception.hands.hand_contacts import HandContacts
from egophys_core.perception.hands.hand_outline import HandOutline
from egophys_core.perception.observation import HandSight
from egophys_core.perception.stages import View
from tests.perception.hands.arm_drawing import SIDE, arm_mask, disc

MATRIX = np.array([[300.0, 0, SIDE / 2], [0, 300, SIDE / 2], [0, 0, 1]])
VIEW = View(
    stamp_ns=0, image=np.zeros((SIDE, SIDE, 3), np.uint8), camera_matrix=MATRIX, world_from_camera=np.eye(4)
)  # fmt: skip
OBJECT = disc((110, 160), 70)
X, Y = np.meshgrid(np.linspace(-0.2, 0.03, 12), np.linspace(-0.1, 0.1, 12))
REST = np.column_stack([X.ravel(), Y.ravel(), np.full(X.size, 0.5)])
NEAR = np.linalg.norm(REST - [0.0, 0, 0.5], axis=1) < 0.1


def arm_at(x: int) -> SeenArm:
    return find_arms(arm_mask((SIDE - 1, 160), (x, 160)), OBJECT)[0]


def step(
    contacts: HandContacts, arm: SeenArm, moved: np.ndarray, by: float = 0.004, seconds: float = 0.0
) -> HandSight | None:
    positions = REST + by * moved[:, None] * [0.0, 0, -1.0]
    view = replace(VIEW, stamp_ns=round(1e9 * seconds))
    return contacts.next(view, {0: arm}, positions, np.ones(len(REST), bool), lambda: OBJECT).get(0)


def test_a_hand_has_contact_once_what_is_near_it_has_moved_for_some_views() -> None:
    contacts = HandContacts(REST, is_solid=False)
    still = np.zeros(len(REST), bool)
    sights = [step(contacts, arm_at(160), moved) for moved in (still, NEAR, still, NEAR, NEAR, NEAR, still)]
    assert [sight is not None and sight.has_contact for sight in sights] == [False] * 5 + [True] * 2
    assert sights[-1] is not None
    assert sights[-1].grip[2] == pytest.approx(0.5, abs=0.01)


def test_what_hands_hold_guides_a_sheet_and_no_solid() -> None:
    for is_solid in (False, True):
        contacts = HandContacts(REST, is_solid=is_solid)
        for _ in range(3):
            sight = step(contacts, arm_at(160), NEAR)
        assert sight is not None
        assert sight.holds
        assert sight.is_led == is_solid
        held = contacts.held(VIEW, {0: arm_at(160)})
        assert (len(held.vertices) > 0) != is_solid


def test_a_hand_that_comes_over_the_object_as_that_moves_pushes() -> None:
    still = np.zeros(len(REST), bool)
    pushed, held = HandContacts(REST, is_solid=False), HandContacts(REST, is_solid=False)
    for x, moved in ((240, still), (225, still), (200, NEAR), (185, NEAR), (170, NEAR)):
        push = step(pushed, arm_at(x), moved)
        hold = step(held, arm_at(170), moved)
    assert push is not None
    assert hold is not None
    assert push.has_contact
    assert not push.holds
    assert hold.holds


def test_a_hand_beside_what_moves_has_none() -> None:
    contacts = HandContacts(REST, is_solid=False)
    far = np.linalg.norm(REST - [-0.2, 0, 0.5], axis=1) < 0.05
    assert not any(step(contacts, arm_at(160), far).has_contact for _ in range(6))
    assert not any(step(contacts, arm_at(270), NEAR).has_contact for _ in range(6))


def test_few_vertices_that_shake_are_no_contact() -> None:
    contacts = HandContacts(REST, is_solid=False)
    few = NEAR & (np.cumsum(NEAR) <= 6)
    assert not any(step(contacts, arm_at(160), few).has_contact for _ in range(6))


def test_a_width_by_another_cue_tells_nothing() -> None:
    contacts, arm = HandContacts(REST, is_solid=False), arm_at(160)
    outline = HandOutline(centre=arm.centre, form=np.eye(2) / 30.0**2, support=0.8)
    for _ in range(3):
        sight = step(contacts, arm.with_outline(outline), NEAR)
    assert sight is not None
    assert sight.radius == pytest.approx(30.0)
    assert step(contacts, replace(arm, radius=22.0), NEAR) is None


def test_the_grip_follows_the_hand_in_space() -> None:
    contacts, arm = HandContacts(REST, is_solid=False), arm_at(160)
    for _ in range(3):
        before = step(contacts, arm, NEAR)
    shifted = replace(arm, centre=arm.centre + [15.0, 0], radius=arm.radius)
    after = step(contacts, shifted, NEAR)
    assert before is not None
    assert after is not None
    np.testing.assert_allclose(after.grip - before.grip, [15.0 * before.depth / 300.0, 0, 0], atol=1e-9)


def test_what_stays_behind_a_hand_unseen_is_doubted_and_seen_is_let_go() -> None:
    contacts, arm = HandContacts(REST, is_solid=False), arm_at(160)
    for _ in range(3):
        step(contacts, arm, NEAR)
    aside = replace(arm, centre=arm.centre + [45.0, 0])
    left = REST + 0.004 * NEAR[:, None] * [0.0, 0, -1.0]
    doubt = contacts.doubt(VIEW, {0: aside}, left)
    far = np.linalg.norm(REST - [0.0, 0, 0.5], axis=1) > 0.12
    assert doubt.max() > 0.05
    assert not doubt[far].any()
    assert contacts.doubt(VIEW, {0: arm}, left).max() < 0.01

    def holds(is_seen: bool) -> bool:
        seen = np.full(len(REST), is_seen)
        return contacts.next(VIEW, {0: aside}, left, seen, lambda: OBJECT)[0].holds

    assert holds(False)
    assert not holds(True)


@pytest.mark.parametrize("rate", [15, 30, 60])
def test_a_hold_is_told_from_a_push_at_any_rate(rate: int) -> None:
    """The hand comes within a tenth of a second, and rests for a quarter of one before the object moves."""
    still = np.zeros(len(REST), bool)
    holding, pushing = HandContacts(REST, is_solid=True), HandContacts(REST, is_solid=True)
    for frame in range(round(0.5 * rate)):
        seconds = frame / rate
        moved = NEAR if seconds > 0.35 else still
        hold = step(holding, arm_at(240 if seconds < 0.1 else 170), moved, seconds=seconds)
        push = step(pushing, arm_at(240 if seconds < 0.34 else 170), moved, seconds=seconds)
    for _ in range(3):
        hold = step(holding, arm_at(170), NEAR, seconds=seconds) or hold
        push = step(pushing, arm_at(170), NEAR, seconds=seconds) or push
    assert hold is not None
    assert push is not None
    assert hold.holds
    assert not push.holds
