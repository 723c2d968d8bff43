"""When hands hold, press and let go, on episodes whose truth is written in the test."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from egophys_core.episode import Episode
from egophys_core.observation import contact_flags, find_hands, observe_episode
from egophys_core.observation.contact import see_hands
from egophys_core.observation.unmoved import why_unmoved
from egophys_core.simulation import ContactKind
from tests.identification.synthetic import ARRIVAL, FPS, episode_of, known_model, make_episode, sheet_episode, without
from tests.simulation.scenes import sheet_positions

HOLD, PRESS = ContactKind.HOLD, ContactKind.PRESS
RADIUS = 0.06
ABOVE = np.array([0, 0, 2 * RADIUS + 0.012])
"""Where a hand holds the ball, its centre 12 mm off the surface."""
BESIDE = np.array([RADIUS + 0.025, 0, RADIUS])
"""Where a hand touches the ball from the side."""


def ball(count: int = 200) -> np.ndarray:
    """[count, 3] metres: points on a ball that lies on the table at the origin."""
    index = np.arange(count) + 0.5
    height, angle = 1 - 2 * index / count, np.pi * (1 + 5**0.5) * index
    flat = np.sqrt(1 - height**2)
    return RADIUS * np.stack([flat * np.cos(angle), flat * np.sin(angle), height + 1], axis=1)


def path(times: np.ndarray, *stops: tuple[float, Sequence[float] | np.ndarray]) -> np.ndarray:
    """[T, 3] metres: from stop to stop (time, position), speeding up and slowing down smoothly."""
    position = np.tile(np.asarray(stops[0][1], float), (len(times), 1))
    for (begin, _), (end, place) in pairwise(stops):
        share = np.clip((times - begin) / (end - begin), 0, 1)[:, None]
        arrived = times >= begin
        here = position[arrived][0]
        position[arrived] = (here + (share**2 * (3 - 2 * share)) * (np.asarray(place) - here))[arrived]
    return position


def carried(times: np.ndarray, hand: np.ndarray, *held: tuple[float, float]) -> np.ndarray:
    """[T, 3] metres: displacement of an object that moves with the hand between the times of each pair."""
    moves = np.zeros_like(hand)
    inside = np.any([(times[1:] > begin + 1e-9) & (times[1:] <= end + 1e-9) for begin, end in held], axis=0)
    moves[1:][inside] = np.diff(hand, axis=0)[inside]
    return np.cumsum(moves, axis=0)


def fingers(hand: np.ndarray, count: int = 8) -> np.ndarray:
    """[T, count, 3] metres: points of a hand around its centre, or the centre itself."""
    turn = 2 * np.pi * np.arange(count) / count
    around = 0.012 * np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=1)
    return hand[:, None] + (around if count > 1 else 0.0)


def seconds(duration: float, rate: float = 30.0) -> np.ndarray:
    """[T] frame times."""
    return np.arange(round(duration * rate) + 1) / rate


def observed(
    times: np.ndarray, points: np.ndarray, controllers: np.ndarray, noise: float = 0.0015, seed: int = 0
) -> Episode:
    """The episode with noise on the points."""
    scatter = np.random.default_rng(seed).normal(0, noise, points.shape)
    return episode_of(points + scatter, controllers, times)


def found(episode: Episode) -> list[list[tuple[ContactKind, float, float]]]:
    """Kind and times in seconds of the contacts of each hand."""
    at = episode.times
    return [[(each.kind, at[each.first], at[each.last]) for each in hand.contacts] for hand in find_hands(episode)]


def about(kind: ContactKind, first: float, last: float, within: float = 0.1):
    """A contact expected to begin and end at these times, in seconds."""
    return (kind, pytest.approx(first, abs=within), pytest.approx(last, abs=within))


HOVER = ABOVE + [0, 0, 0.2]


def lift_and_let_go(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[T, 3] hand and object: holds from 1.0 s, lifts at 1.2 s, sets down and leaves at 3.0 s."""
    down = ABOVE + [0.1, 0, 0]
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.0, down + [0, 0, 0.1]), (2.7, down))
    hand += path(times, (3.0, [0, 0, 0]), (3.6, [0, 0, 0.2]))
    return hand, carried(times, hand, (1.0, 3.0))


def push_and_retreat(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[T, 3] hand and object: the hand comes from the side, pushes from about 1.0 s to 1.7 s, leaves at 2.0 s."""
    hand = path(times, (0.5, BESIDE + [0.08, 0, 0]), (1.7, BESIDE - [0.1, 0, 0]), (2.0, BESIDE - [0.1, 0, 0]))
    hand += path(times, (2.0, [0, 0, 0]), (2.8, [0.15, 0, 0]))
    return hand, np.minimum.accumulate(np.minimum(hand - BESIDE, 0.0), axis=0)


def touch_time(times: np.ndarray, displacement: np.ndarray) -> float:
    """Seconds: last frame before the object moves."""
    return float(times[np.flatnonzero(np.linalg.norm(displacement, axis=1) > 0)[0] - 1])


RATES_AND_NOISE = [(rate, noise) for rate in (15.0, 30.0, 60.0) for noise in (0.0, 0.0015, 0.003)]


def test_hold_of_a_simulated_sheet_begins_when_the_hand_has_arrived_and_lasts_while_it_lifts():
    episode = sheet_episode()
    (hand,) = find_hands(episode)
    assert hand.controllers.tolist() == [0, 1, 2]
    (contact,) = hand.contacts
    assert contact.kind == HOLD
    assert hand.first == contact.first == pytest.approx(ARRIVAL / FPS, abs=1)
    assert contact.last == episode.frames - 1
    assert hand.touches


def test_hold_of_a_soft_sheet_that_lags_behind_begins_when_the_hand_has_arrived():
    episode = make_episode(known_model(stiffness_rate=0.2, damping_rate=0.7))
    (hand,) = find_hands(episode)
    assert [each.kind for each in hand.contacts] == [HOLD]
    assert hand.first == pytest.approx(ARRIVAL / FPS, abs=1)


@pytest.mark.parametrize(("rate", "noise"), RATES_AND_NOISE)
@pytest.mark.parametrize("count", [1, 8])
def test_hold_then_let_go(rate, noise, count):
    times = seconds(4.5, rate)
    hand, displacement = lift_and_let_go(times)
    episode = observed(times, ball() + displacement[:, None], fingers(hand, count), noise)
    assert found(episode) == [[about(HOLD, 1.0, 3.0)]]


@pytest.mark.parametrize(("rate", "noise"), RATES_AND_NOISE)
@pytest.mark.parametrize("count", [1, 8])
def test_press_then_retreat_leaves_the_object_behind(rate, noise, count):
    times = seconds(3.5, rate)
    hand, displacement = push_and_retreat(times)
    episode = observed(times, ball() + displacement[:, None], fingers(hand, count), noise)
    assert found(episode) == [[about(PRESS, touch_time(times, displacement), 2.1)]]


@pytest.mark.parametrize("speed", [0.03, 0.1, 1.0])
def test_slow_and_fast_hands_are_judged_by_the_way_they_go(speed):
    duration = 0.15 / speed
    times = seconds(2.0 + 2 * duration)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (1.2 + duration, ABOVE + [0, 0, 0.15]))
    leave = 1.4 + duration
    hand += path(times, (leave, [0, 0, 0]), (leave + duration, [0, 0.15, 0]))
    displacement = carried(times, hand, (1.0, leave))
    ((contact,),) = found(observed(times, ball() + displacement[:, None], fingers(hand)))
    assert contact[:2] == (HOLD, pytest.approx(1.0, abs=0.1))
    # It may be a centimetre away before it is seen to leave.
    moved = np.linalg.norm(hand[round(contact[2] * 30)] - hand[round(leave * 30)])
    assert contact[2] >= leave - 0.1
    assert moved < 0.015


@pytest.mark.parametrize("direction", [(0.15, 0, 0), (0, 0.15, 0), (-0.1, 0.1, 0)])
def test_hand_that_drags_an_object_from_above_holds_it(direction):
    times = seconds(4.0)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.2, ABOVE + direction))
    displacement = carried(times, hand, (1.0, 4.0))
    assert found(observed(times, ball() + displacement[:, None], fingers(hand))) == [[about(HOLD, 1.0, 4.0)]]


def test_hand_takes_hold_twice_in_different_places():
    times = seconds(6.0)
    hand, _ = lift_and_let_go(times)
    again = np.array([0.1, 0, 0]) + BESIDE
    back = path(times, (3.6, hand[108]), (4.2, again), (4.4, again), (5.2, again + [0.1, 0.05, 0.05]))
    hand = np.where((times > 3.6)[:, None], back, hand)
    displacement = carried(times, hand, (1.0, 3.0), (4.2, 6.0))
    episode = observed(times, ball() + displacement[:, None], fingers(hand))
    assert found(episode) == [[about(HOLD, 1.0, 3.0), about(HOLD, 4.2, 6.0)]]


def test_hand_presses_twice():
    times = seconds(5.5)
    hand, _ = push_and_retreat(times)
    hand += path(times, (3.2, [0, 0, 0]), (4.4, [-0.2, 0, 0]), (4.6, [-0.2, 0, 0]), (5.2, [0, 0, 0]))
    displacement = np.minimum.accumulate(np.minimum(hand - BESIDE, 0.0), axis=0)
    one, two = found(observed(times, ball() + displacement[:, None], fingers(hand)))[0]
    assert one == about(PRESS, touch_time(times, displacement), 2.1)
    assert (two[0], two[2]) == (PRESS, pytest.approx(4.75, abs=0.1))
    # The second time it moves the object on from where the first left it, 10 cm away.
    moves_on = times[np.flatnonzero(displacement[:, 0] < -0.1005)[0]]
    assert two[1] == pytest.approx(moves_on, abs=0.1)


def test_press_on_an_object_that_gives_before_it_moves_begins_with_the_touch():
    # Points near the hand fall behind it by up to 1 cm while the object is squeezed, most of that in 2 frames.
    times = seconds(3.5)
    hand, displacement = push_and_retreat(times)
    squeezed = 0.01 * (1 - np.exp(displacement[:, :1] / 0.01)) * [1, 0, 0]
    episode = observed(times, ball() + (displacement + squeezed)[:, None], fingers(hand))
    ((contact,),) = found(episode)
    assert contact[:2] == (PRESS, pytest.approx(touch_time(times, displacement), abs=0.04))


def test_press_on_few_points_that_drop_out_is_one_press():
    times = seconds(3.5)
    hand, displacement = push_and_retreat(times)
    for seed in range(4):
        points = ball(60) + displacement[:, None]
        points[np.random.default_rng(seed).random(points.shape[:2]) < 0.4] = np.nan
        ((contact,),) = found(observed(times, points, fingers(hand), 0.003))
        assert contact == about(PRESS, touch_time(times, displacement), 2.1, within=0.2)


def test_pressing_into_a_soft_object_that_springs_back_is_no_hold():
    times = seconds(3.0)
    depth = path(times, (1.0, [0, 0, 0]), (1.4, [0, 0, -0.025]), (1.6, [0, 0, -0.025]), (2.0, [0, 0, 0]))[:, 2]
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (2.0, ABOVE), (2.6, HOVER)) + depth[:, None] * [0, 0, 1]
    shape = ball()
    dent = np.exp(-(np.linalg.norm(shape - [0, 0, 2 * RADIUS], axis=1) ** 2) / 0.05**2)
    points = shape + (depth[:, None] * dent)[..., None] * [0, 0, 1]
    ((contact,),) = found(observed(times, points, fingers(hand)))
    assert contact[0] == PRESS
    assert contact[1] == pytest.approx(1.05, abs=0.1)
    assert 1.6 <= contact[2] <= 2.2


def test_folding_a_sheet_over_onto_itself_is_a_hold():
    # The half x > 0 turns about the y axis by 170 degrees, the hand with its far corner; then the hand leaves.
    times = seconds(4.0)
    sheet = sheet_positions(13, 0.02, 0.004)
    sheet = sheet - sheet.mean(axis=0) * [1, 1, 0]
    turn = path(times, (1.2, [0, 0, 0]), (2.8, [np.radians(170), 0, 0]))[:, 0]
    radius = np.maximum(sheet[:, 0], 0)
    points = np.repeat(sheet[None], len(times), axis=0)
    points[..., 0] += radius * (np.cos(turn)[:, None] - 1)
    points[..., 2] += radius * np.sin(turn)[:, None]
    corner = int(np.argmax(sheet.sum(axis=1)))
    away = path(times, (0.4, [0, 0, 0.2]), (1.0, [0, 0, 0.006]), (3.1, [0, 0, 0.006]), (3.6, [0, 0, 0.2]))
    hand = points[:, corner] + away
    assert found(observed(times, points, fingers(hand))) == [[about(HOLD, 1.0, 3.1)]]


@pytest.mark.parametrize(("hidden", "expected"), [((0.8, 1.6), 1.0), ((1.5, 2.5), 1.0), ((1.1, 9.0), 1.0)])
def test_points_hidden_by_the_hand_do_not_end_the_hold(hidden, expected):
    times = seconds(4.0)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.2, ABOVE + [0.1, 0, 0.1]), (3.4, ABOVE))
    displacement = carried(times, hand, (1.0, 4.0))
    episode = observed(times, ball() + displacement[:, None], fingers(hand))
    near = np.flatnonzero(np.linalg.norm(ball() - ABOVE, axis=1) < 0.04)
    points = episode.points.copy()
    points[np.ix_((times >= hidden[0]) & (times <= hidden[1]), near)] = np.nan
    assert found(episode_of(points, episode.controllers, times)) == [[about(HOLD, expected, 4.0)]]


def test_points_that_drop_out_at_random_do_not_matter():
    times = seconds(4.5)
    for motion, expected in ((lift_and_let_go, about(HOLD, 1.1, 3.0)), (push_and_retreat, about(PRESS, 0.97, 2.1))):
        hand, displacement = motion(times)
        episode = observed(times, ball() + displacement[:, None], fingers(hand))
        points = np.where(
            np.random.default_rng(1).random(episode.points.shape[:2])[..., None] < 0.5, np.nan, episode.points
        )
        assert found(episode_of(points, episode.controllers, times)) == [[expected]]


def test_object_dropped_by_a_hand_that_stays_is_let_go_as_it_falls():
    times = seconds(4.0)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.0, ABOVE + [0, 0, 0.2]))
    displacement = carried(times, hand, (1.0, 4.0))
    displacement[:, 2] = np.maximum(displacement[:, 2] - 4.905 * np.maximum(times - 2.5, 0) ** 2, 0)
    assert found(observed(times, ball() + displacement[:, None], fingers(hand))) == [[about(HOLD, 1.0, 2.5)]]


def test_what_hangs_from_a_hand_inside_it_is_held_and_not_pushed_upwards():
    # The points near a hand that holds a ball 3 cm below its top are above it.
    times = seconds(3.5)
    inside = ABOVE - [0, 0, 0.042]
    hand = path(times, (0.4, HOVER), (1.0, inside), (1.2, inside), (2.2, inside + [0, 0, 0.3]))
    displacement = carried(times, hand, (1.0, 3.5))
    assert found(observed(times, ball() + displacement[:, None], fingers(hand))) == [[about(HOLD, 1.0, 3.5)]]


def test_what_swings_out_in_a_hand_that_stands_still_is_held_until_it_drops():
    # It turns by a radian about the hand within 0.2 s after the lift, and drops a second later.
    times = seconds(3.8)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.0, ABOVE + [0, 0, 0.3]))
    turn = path(times, (1.95, [0, 0, 0]), (2.15, [1.0, 0, 0]))[:, 0]
    arm = ball() - ABOVE
    turned = np.stack(
        [
            np.cos(turn)[:, None] * arm[:, 0] - np.sin(turn)[:, None] * arm[:, 2],
            np.broadcast_to(arm[:, 1], (len(times), len(arm))),
            np.sin(turn)[:, None] * arm[:, 0] + np.cos(turn)[:, None] * arm[:, 2],
        ],
        axis=2,
    )
    displacement = carried(times, hand, (1.0, 3.8))
    displacement[:, 2] -= 4.905 * np.maximum(times - 3.3, 0) ** 2
    episode = observed(times, ABOVE + turned + displacement[:, None], fingers(hand))
    assert found(episode) == [[about(HOLD, 1.0, 3.3)]]


def test_object_that_slips_slowly_through_the_hand_is_held():
    times = seconds(6.0)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.2, ABOVE + [0, 0, 0.25]))
    hand += path(times, (3.0, [0, 0, 0]), (4.0, [0.15, 0, 0]), (5.5, [0, 0.1, 0]))
    displacement = carried(times, hand, (1.0, 6.0))
    displacement[:, 2] -= 0.027 * np.maximum(times - 2.5, 0)
    assert found(observed(times, ball() + displacement[:, None], fingers(hand))) == [[about(HOLD, 1.0, 6.0)]]


@pytest.mark.parametrize("rate", [15.0, 30.0, 60.0])
@pytest.mark.parametrize("delay", [0.1, 0.4, 0.8])
def test_points_recorded_late_do_not_move_the_hold(rate, delay):
    times = seconds(5.0, rate)
    hand = path(
        times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.0, ABOVE + [0.1, 0, 0.2]), (2.6, ABOVE), (3.2, HOVER)
    )
    displacement = carried(times, hand, (1.0, 5.0))
    late = round(delay * rate)
    points = (ball() + displacement[:, None])[np.maximum(np.arange(len(times)) - late, 0)]
    episode = observed(times, points, fingers(hand))
    assert see_hands(episode).delay == pytest.approx(late / rate, abs=0.02)
    # What came after the last frame of the hands' time is not seen.
    assert found(episode) == [[about(HOLD, 1.0, 5.0)]]


@pytest.mark.parametrize("delay", [0.05, 0.15])
def test_points_recorded_a_little_late_do_not_loosen_the_hold_of_a_hand_that_swings_fast(delay):
    times = seconds(6.0, 60.0)
    hand = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.0, ABOVE + [0, 0, 0.2]))
    swings = (times > 2.5) & (times < 2.5 + 5 / 2.2)
    hand[swings, 1] += 0.08 * np.sin(2 * np.pi * 2.2 * (times[swings] - 2.5))
    late = round(delay * 60.0)
    points = (ball() + carried(times, hand, (1.0, 6.0))[:, None])[np.maximum(np.arange(len(times)) - late, 0)]
    episode = observed(times, points, fingers(hand))
    assert see_hands(episode).delay == pytest.approx(delay, abs=0.01)
    assert found(episode) == [[about(HOLD, 1.0, 6.0)]]


def test_pushed_object_that_follows_late_is_not_taken_for_points_recorded_late():
    times = seconds(3.0)
    hand = path(times, (0.5, BESIDE + [0.1, 0, 0]), (2.0, BESIDE - [0.1, 0, 0]))
    displacement = np.minimum.accumulate(np.minimum(hand - BESIDE, 0.0), axis=0)
    # It rolls on: its points go by half of the hand's way at first and overtake it later.
    rolled = displacement * (0.5 + np.clip(times - 1.2, 0, 0.8))[:, None]
    assert see_hands(observed(times, ball() + rolled[:, None], fingers(hand))).delay == 0.0


def test_recording_that_starts_in_the_grasp_is_held_from_its_first_frame():
    times = seconds(2.0)
    hand = path(times, (0.0, ABOVE), (1.0, ABOVE + [0.1, 0, 0.1]))
    displacement = carried(times, hand, (0.0, 2.0))
    assert found(observed(times, ball() + displacement[:, None], fingers(hand))) == [
        [about(HOLD, 0.0, 2.0, within=0.04)]
    ]


def passes_by(times: np.ndarray) -> np.ndarray:
    return path(times, (0.5, ABOVE + [0.3, 0, 0.03]), (2.0, ABOVE + [-0.3, 0, 0.03]))


def rests(times: np.ndarray) -> np.ndarray:
    return path(times, (0.4, HOVER), (1.0, ABOVE), (2.0, ABOVE), (2.6, HOVER))


def stays_away(times: np.ndarray) -> np.ndarray:
    return path(times, (0.5, ABOVE + [0.1, 0, 0.3]), (2.0, ABOVE + [-0.3, 0, 0.3]))


@pytest.mark.parametrize("motion", [passes_by, rests, stays_away])
@pytest.mark.parametrize("noise", [0.0015, 0.003])
def test_hand_that_moves_nothing_has_no_contact(motion: Callable, noise):
    times = seconds(3.0)
    episode = observed(times, np.tile(ball(), (len(times), 1, 1)), fingers(motion(times)), noise)
    (hand,) = find_hands(episode)
    assert not hand.touches
    assert not contact_flags(episode, [hand]).any()


def test_object_that_rocks_by_itself_under_a_hand_is_not_touched():
    # 1.5 cm to and fro at 1 Hz beside a hand that comes near, waits and leaves.
    times = seconds(5.0)
    displacement = np.zeros((len(times), 3))
    displacement[:, 0] = 0.0075 * np.sin(2 * np.pi * times)
    beside = BESIDE + [0.02, 0, 0]
    hand = path(times, (1.0, beside + [0.2, 0, 0]), (2.0, beside), (3.5, beside), (4.5, beside + [0.2, 0, 0]))
    assert found(observed(times, ball() + displacement[:, None], fingers(hand))) == [[]]


def test_each_of_two_hands_has_its_own_contacts():
    # One holds from 1.0 s to the end; the other pushes against the held object's side before, and stays away later.
    times = seconds(5.0)
    pusher, displacement = push_and_retreat(times)
    shifted = ABOVE - [0.1, 0, 0]
    holder = path(times, (2.4, shifted + [0, 0, 0.3]), (3.2, shifted), (3.4, shifted), (4.2, shifted + [0, 0.1, 0.15]))
    displacement = displacement + carried(times, holder, (3.2, 5.0))
    controllers = np.concatenate([fingers(pusher), fingers(holder)], axis=1)
    episode = observed(times, ball() + displacement[:, None], controllers)
    touch = touch_time(times, displacement)
    assert found(episode) == [[about(PRESS, touch, 2.1)], [about(HOLD, 3.2, 5.0)]]
    hands = find_hands(episode)
    flags = contact_flags(episode, hands)
    hold, press = flags == HOLD, flags == PRESS
    assert not hold[:, :8].any()
    assert not press[:, 8:].any()
    assert press[:, 0].sum() == hands[0].contacts[0].last - hands[0].first + 1
    assert hold[-1, 8:].all()


def test_hand_that_waits_beside_an_object_others_pull_away_does_not_touch_it():
    times = seconds(4.0)
    holder = path(times, (0.4, HOVER), (1.0, ABOVE), (1.2, ABOVE), (2.2, ABOVE + [-0.2, 0, 0.1]))
    displacement = carried(times, holder, (1.0, 4.0))
    waiting = np.tile(BESIDE + [0.01, 0, 0], (len(times), 1))
    controllers = np.concatenate([fingers(holder), fingers(waiting)], axis=1)
    one, other = found(observed(times, ball() + displacement[:, None], controllers))
    assert one == [about(HOLD, 1.0, 4.0)]
    assert other == []


def test_points_that_come_together_are_one_hand_and_others_another():
    times = seconds(3.0)
    left, right = ABOVE, ABOVE + [0.4, 0, 0]
    lift = path(times, (1.0, [0, 0, 0]), (2.0, [0, 0, 0.1]))
    controllers = np.stack([place + lift for place in (left, right, left + [0.02, 0, 0], right - [0.02, 0, 0])], axis=1)
    points = np.concatenate([ball(), ball() + [0.4, 0, 0]]) + lift[:, None]
    one, other = find_hands(observed(times, points, controllers))
    assert (one.controllers.tolist(), other.controllers.tolist()) == ([0, 2], [1, 3])
    assert (one.first, other.first) == (0, 0)


def test_hidden_points_and_frames_of_a_simulated_sheet_do_not_move_the_hold():
    behind_fingers = without(sheet_episode(), frames=slice(8, 40), points=slice(20, 25))
    all_hidden = without(sheet_episode(), frames=slice(14, 20), points=slice(None))
    for episode in (behind_fingers, all_hidden):
        ((contact,),) = (hand.contacts for hand in find_hands(episode))
        assert contact.kind == HOLD
        assert contact.first == pytest.approx(ARRIVAL / FPS, abs=2)
        assert contact.last == episode.frames - 1


def test_episode_without_controllers_has_no_hands():
    times = seconds(1.0)
    episode = episode_of(np.tile(ball(), (len(times), 1, 1)), np.zeros((len(times), 0, 3)), times)
    assert find_hands(episode) == ()


def test_recorded_contacts_are_taken_as_they_are():
    # Of a hand that lifts from 1.0 to 3.0 s it was recorded that fingers 0 and 1 hold in two spans, the others never.
    times = seconds(4.0)
    hand, displacement = lift_and_let_go(times)
    episode = observed(times, ball() + displacement[:, None], fingers(hand))
    flags = np.zeros((len(times), 8), bool)
    flags[20:50, :2] = flags[60:, :2] = True
    declared = replace(episode, contact=flags)
    hands = find_hands(declared)
    by_fingers = {tuple(each.controllers.tolist()): [(one.first, one.last) for one in each.contacts] for each in hands}
    assert by_fingers == {(0, 1): [(20, 49), (60, len(times) - 1)], (2, 3, 4, 5, 6, 7): []}
    assert np.array_equal(contact_flags(declared, hands) == HOLD, flags)
    assert observe_episode(declared).touched == 20


def test_where_no_hand_holds_by_the_record_that_is_said():
    episode = sheet_episode()
    never = replace(episode, contact=np.zeros(episode.controllers.shape[:2], bool))
    assert "field contact of its controllers is 0 in all frames" in why_unmoved(never)


def test_what_is_said_has_the_last_word_on_contacts():
    times = seconds(4.0)
    hand, displacement = lift_and_let_go(times)
    episode = observed(times, ball() + displacement[:, None], fingers(hand))
    declared = replace(episode, contact=np.zeros((len(times), 8), bool), held=True)
    assert found(declared) == [[about(HOLD, 0.0, times[-1])]]
