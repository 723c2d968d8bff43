"""What drives a twin: hands that hold by their points, hands that press by their middle."""

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.contact import Contact, Hand
from egophys_core.observation.driving import controls_of
from egophys_core.simulation import ContactKind

NONE, HOLD, PRESS = ContactKind.NONE, ContactKind.HOLD, ContactKind.PRESS
FRAMES = 12


def episode() -> Episode:
    """Two hands of two points each, which move."""
    points = np.arange(FRAMES)[:, None, None] * [0.01, 0, 0] + np.arange(4)[:, None] * [0.0, 0.02, 0.0]
    return Episode(
        name="hands",
        times=np.arange(FRAMES) / 30,
        points=np.zeros((FRAMES, 3, 3), np.float32),
        confidence=np.ones((FRAMES, 3), np.float32),
        controllers=points.astype(np.float32),
        point_ids=np.arange(3, dtype=np.uint32),
        controller_ids=np.arange(4, dtype=np.uint32),
        ground_height=0.0,
    )


def hand(points: list[int], *contacts: tuple[int, int, ContactKind]) -> Hand:
    found = tuple(Contact(first=first, last=last, kind=kind) for first, last, kind in contacts)
    return Hand(controllers=np.array(points), contacts=found)


def test_hands_that_hold_drive_by_all_their_points():
    shown = episode()
    controls = controls_of(shown, (hand([0, 1], (2, 5, HOLD)), hand([2, 3])))
    assert np.array_equal(controls.positions, shown.controllers)
    assert np.flatnonzero(controls.contact[:, 0]).tolist() == [2, 3, 4, 5]
    assert not controls.contact[:, 2:].any()


def test_a_hand_that_presses_is_a_ball_about_its_middle_until_it_takes_hold():
    shown = episode()
    controls = controls_of(shown, (hand([0, 1]), hand([2, 3], (3, 4, PRESS), (8, 9, HOLD))))
    assert controls.positions.shape == (FRAMES, 5, 3)
    assert np.allclose(controls.positions[:, 4], shown.controllers[:, 2:].mean(axis=1))
    assert controls.contact[:, 4].tolist() == [NONE] * 3 + [PRESS] * 5 + [NONE] * 4
    assert controls.contact[:, 2].tolist() == [NONE] * 8 + [HOLD] * 2 + [NONE] * 2


def test_a_press_that_nothing_follows_lasts_to_the_end():
    controls = controls_of(episode(), (hand([0, 1], (3, 4, PRESS)), hand([2, 3], (5, 6, HOLD))))
    assert controls.contact[:, 4].tolist() == [NONE] * 3 + [PRESS] * 9
