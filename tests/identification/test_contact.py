"""When a hand is taken to hold the object."""

import numpy as np
import pytest

from egophys_core.identification import find_hands, hold_flags
from tests.identification.synthetic import ARRIVAL, FPS, episode_of, sheet_episode, without
from tests.simulation.scenes import sheet_positions


def test_hold_begins_when_the_hand_has_arrived_and_lasts_while_it_lifts():
    episode = sheet_episode()
    (hand,) = find_hands(episode)
    assert hand.controllers.tolist() == [0, 1, 2]
    assert hand.first == pytest.approx(ARRIVAL / FPS, abs=1)
    assert hand.last == episode.frames - 1
    assert hand.holds


def test_hold_ends_when_the_hand_moves_away():
    points = np.tile(sheet_positions(), (90, 1, 1))
    frames = np.arange(90)
    away = np.maximum(np.maximum(20 - frames, frames - 60), 0) * 0.01
    controllers = np.tile(points[0, :1] + [0, 0, 0.01], (90, 1, 1))
    controllers[:, 0, 2] += away
    episode = episode_of(points, controllers)
    (hand,) = find_hands(episode)
    assert hand.first == pytest.approx(20, abs=1)
    assert hand.last == pytest.approx(60, abs=1)
    flags = hold_flags(episode, [hand])
    assert np.flatnonzero(flags[:, 0]).tolist() == list(range(hand.first, hand.last + 1))


def test_hand_that_passes_over_at_speed_does_not_hold_while_it_still_reaches():
    # Down at 0.3 m/s to frame 30, then still.
    points = np.tile(sheet_positions(), (60, 1, 1))
    controllers = np.tile(points[0, :1] + [0, 0, 0.002], (60, 1, 1))
    controllers[:, 0, 2] += np.maximum(30 - np.arange(60), 0) * 0.01
    (hand,) = find_hands(episode_of(points, controllers))
    assert 29 <= hand.first <= 31


def test_hand_that_carries_the_object_holds_it_however_fast():
    # At 0.3 m/s from frame 20 on, object and hand together: the speed that counts is relative.
    shift = np.maximum(np.arange(60) - 20, 0)[:, None, None] * [0.01, 0, 0]
    points = sheet_positions() + shift
    controllers = points[:, :1] + [0, 0, 0.01]
    (hand,) = find_hands(episode_of(points, controllers))
    assert (hand.first, hand.last) == (0, 59)


def test_hand_far_from_the_object_never_holds():
    points = np.tile(sheet_positions(), (30, 1, 1))
    controllers = np.tile([[0.0, 0.0, 0.5]], (30, 1, 1))
    (hand,) = find_hands(episode_of(points, controllers))
    assert not hand.holds
    assert not hold_flags(episode_of(points, controllers), [hand]).any()


def test_points_that_come_together_are_one_hand_and_others_another():
    frames = np.arange(40)
    points = np.tile(sheet_positions(), (40, 1, 1))
    left, right = points[0, 0] + [0, 0, 0.01], points[0, -1] + [0, 0, 0.01]
    controllers = np.stack([np.tile(p, (40, 1)) for p in (left, right, left + [0.02, 0, 0], right - [0.02, 0, 0])], 1)
    controllers[:, [1, 3], 2] += np.maximum(25 - frames, 0)[:, None] * 0.01
    one, other = find_hands(episode_of(points, controllers))
    assert (one.controllers.tolist(), other.controllers.tolist()) == ([0, 2], [1, 3])
    assert one.first == 0
    assert other.first == pytest.approx(25, abs=1)
    flags = hold_flags(episode_of(points, controllers), [one, other])
    assert flags[10].tolist() == [True, False, True, False]
    assert flags[35].all()


def test_points_hidden_by_the_hand_do_not_move_the_onset():
    episode = sheet_episode()
    hidden = without(episode, frames=slice(8, 40), points=slice(19, 25))
    (hand,) = find_hands(hidden)
    assert hand.first == pytest.approx(ARRIVAL / FPS, abs=2)


def test_frames_without_any_visible_point_are_no_contact():
    episode = without(sheet_episode(), frames=slice(14, 20), points=slice(None))
    (hand,) = find_hands(episode)
    assert hand.first == pytest.approx(ARRIVAL / FPS, abs=1)
    assert hand.last == episode.frames - 1
