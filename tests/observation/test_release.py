"""The moment at which hands let go is between two frames: it becomes one."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.observation import find_hands, observe_episode
from egophys_core.simulation import ContactKind
from tests.observation.falling import dropped
from tests.observation.test_contact import ABOVE, HOVER, ball, carried, fingers, observed, path, seconds


@pytest.mark.parametrize("rate", [20.0, 30.0, 60.0])
@pytest.mark.parametrize("later", [0.1, 0.5, 0.9])
def test_what_is_dropped_falls_from_the_moment_at_which_it_is_let_go(rate: float, later: float):
    let_go = 2.8 + later / rate
    episode = dropped(let_go, rate=rate)
    seen = observe_episode(episode)
    (frame,) = seen.falls
    assert seen.episode.times[frame] == pytest.approx(let_go, abs=0.003)
    assert (seen.contact[frame - 1] == ContactKind.HOLD).all()
    assert (seen.contact[frame:] == ContactKind.NONE).all()
    own = np.delete(np.arange(seen.episode.frames), frame)
    if seen.episode.frames > episode.frames:
        assert not seen.episode.visible[frame].any()
        assert np.array_equal(seen.episode.times[own], episode.times)
        assert np.array_equal(seen.episode.points[own], episode.points, equal_nan=True)


@pytest.mark.parametrize("aside", [0.06, -0.15])
@pytest.mark.parametrize("rate", [20.0, 30.0, 60.0])
def test_what_is_let_go_on_the_way_falls_from_that_moment(rate: float, aside: float):
    # Its mean is pulled aside by up to 36 m/s^2 before that, more than by gravity after it.
    let_go = 2.8 + 0.4 / rate
    seen = observe_episode(dropped(let_go, rate=rate, aside=aside))
    (frame,) = seen.falls
    assert seen.episode.times[frame] == pytest.approx(let_go, abs=0.003)
    assert (seen.contact[frame - 1] == ContactKind.HOLD).all()
    assert (seen.contact[frame:] == ContactKind.NONE).all()


def test_a_hand_that_seems_to_touch_what_it_let_go_does_not():
    # The hand follows it down for a moment, as that of a person may.
    let_go = 2.815
    episode = dropped(let_go, aside=0.12)
    (frame,) = np.flatnonzero((episode.times > let_go + 0.02) & (episode.times < let_go + 0.06))
    contact = np.zeros((episode.frames, episode.controllers.shape[1]), bool)
    contact[30 : frame - 2] = contact[frame] = True
    seen = observe_episode(replace(episode, contact=contact))
    (fell,) = seen.falls
    assert seen.episode.times[fell] == pytest.approx(let_go, abs=0.003)
    assert (seen.contact[fell:] == ContactKind.NONE).all()


def test_what_is_set_down_does_not_fall():
    times = seconds(4.0)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (1.8, ABOVE + [0, 0, 0.1]), (2.5, ABOVE))
    hand += path(times, (2.8, [0, 0, 0]), (3.4, [0, 0, 0.2]))
    episode = observed(times, ball() + carried(times, hand, (1.0, 2.8))[:, None], fingers(hand))
    seen = observe_episode(episode)
    assert seen.falls == ()
    assert seen.episode is episode


def test_contacts_after_a_fall_are_in_the_new_frames():
    # Let go 45 cm up, taken up once more where it fell, and held to the end.
    let_go, lands = 2.815, 2.815 + np.sqrt(2 * 0.45 / 9.81)
    times = seconds(5.5)
    up = path(times, (1.2, [0, 0, 0]), (2.0, [0, 0, 0.45]), (3.3, [0, 0, 0.45]), (4.1, [0, 0, 0]), (4.4, [0, 0, 0]))
    again = path(times, (4.4, [0, 0, 0]), (5.2, [0, 0, 0.15]))
    hand = path(times, (0.4, HOVER), (1.0, ABOVE)) + up + again
    falling = 0.45 - 4.905 * np.clip(times - let_go, 0, lands - let_go) ** 2
    height = np.where(times < let_go, up[:, 2], falling) + again[:, 2]
    episode = observed(times, ball() + height[:, None, None] * [0, 0, 1], fingers(hand))
    seen = observe_episode(episode)
    (frame,) = seen.falls
    assert seen.episode.times[frame] == pytest.approx(let_go, abs=0.004)
    first, second = seen.hands[0].contacts
    assert first.last == frame - 1
    before = find_hands(episode)[0].contacts[1]
    assert seen.episode.times[second.first] == episode.times[before.first]
    assert seen.episode.times[second.last] == episode.times[before.last]
