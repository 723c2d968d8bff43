"""Observations to an episode, without any images."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.episode_assembly import EpisodeAssembly
from egophys_core.perception.hands.hand_points import at_depth
from egophys_core.perception.observation import HandSight, Observation
from egophys_core.perception.options import PerceptionOptions
from tests.perception.observations import observations

OPTIONS = PerceptionOptions(object_points=60, controllers=8)
GRIP = 4
DEPTH, RADIUS = 0.55, 40.0
"""Metres and pixels: of a hand, everywhere."""


def place(observation: Observation, number: int, frame: int) -> np.ndarray:
    """[3] metres: where a hand holds, in the middle of it."""
    pixel = np.array([[200.0 + frame, 260.0 + 40 * number]])
    return np.asarray(at_depth(pixel, DEPTH, observation.view)[0])


def seen(count: int = 10, *, grips: tuple[int | None, ...] = (GRIP,), holds: bool = False) -> list[Observation]:
    """Observations, all sure, of hands that go to the right, each with contact from a frame on."""
    found = observations(count)
    return [
        replace(
            each,
            confidence=np.ones(len(each.points)),
            hands={
                number: HandSight(
                    pixel=np.array([200.0 + frame, 260.0 + 40 * number]),
                    depth=DEPTH,
                    radius=RADIUS,
                    grip=place(each, number, frame) if grip is not None and frame >= grip else np.full(3, np.nan),
                    holds=holds,
                )
                for number, grip in enumerate(grips)
            },
        )
        for frame, each in enumerate(found)
    ]


def assembled(given: list[Observation], options: PerceptionOptions = OPTIONS) -> EpisodeAssembly:
    assembly = EpisodeAssembly(options=options)
    for each in given:
        assembly.add(each)
    return assembly


def test_times_points_and_ids() -> None:
    given = seen()
    assembly = assembled(given)
    episode = assembly.episode("drawn", 0.0)
    assert assembly.start_ns == given[0].view.stamp_ns
    np.testing.assert_allclose(np.diff(episode.times), 1 / 30, atol=1e-4)
    assert episode.points.shape == (10, 60, 3)
    assert len(np.unique(episode.point_ids)) == 60
    # Each column is one and the same point of the observations.
    first = [int(np.argmin(np.linalg.norm(given[0].points - point, axis=1))) for point in episode.points[0]]
    assert len(set(first)) == 60
    np.testing.assert_allclose(episode.points[-1], given[-1].points[first], atol=1e-5)


def test_points_are_spread_over_the_object() -> None:
    given = seen()
    episode = assembled(given).episode("drawn", 0.0)
    assert np.ptp(episode.points[0], axis=0)[:2] == pytest.approx(np.ptp(given[0].points, axis=0)[:2], rel=0.05)


def test_doubtful_points_are_kept_with_their_doubt_and_others_left_out() -> None:
    given = seen()
    given[3] = replace(given[3], confidence=np.full(len(given[3].points), 0.19))
    given[5] = replace(given[5], confidence=np.full(len(given[5].points), 0.3))
    episode = assembled(given).episode("drawn", 0.0)
    np.testing.assert_allclose(episode.confidence[5], 0.3, atol=1e-6)
    assert np.isnan(episode.points[3]).all()
    assert (episode.confidence[3] == 0).all()
    assert np.isfinite(episode.points[4]).all()


def test_points_deep_in_the_table_are_left_out() -> None:
    given = seen()
    sunk = given[5].points.copy()
    sunk[:, 2] = -0.0051
    given[5] = replace(given[5], points=sunk)
    assert np.isnan(assembled(given).episode("drawn", 0.0).points[5]).all()
    assert np.isfinite(assembled(given).episode("drawn", -0.01).points[5]).any()


def test_a_point_that_jumps_is_left_out() -> None:
    given = seen()
    chosen = assembled(given).episode("drawn", 0.0).points[0, 7]
    jumping = int(np.argmin(np.linalg.norm(given[0].points - chosen, axis=1)))
    moved = given[6].points.copy()
    moved[jumping] += [0.1, 0, 0.05]
    given[6] = replace(given[6], points=moved)
    episode = assembled(given).episode("drawn", 0.0)
    assert np.isnan(episode.points[6]).any(axis=1).sum() == 1


def test_points_that_are_never_sure_have_no_column() -> None:
    given = seen()
    half = np.arange(len(given[0].points)) % 2 == 0
    episode = assembled([replace(each, confidence=np.where(half, 1.0, 0.1)) for each in given]).episode("drawn", 0.0)
    assert 10 < episode.points.shape[1] < 55
    assert np.isfinite(episode.points).all()


def test_controllers_are_about_where_the_hand_is_seen() -> None:
    given, assembly = seen(holds=True), assembled(seen(holds=True))
    episode = assembly.episode("drawn", 0.0)
    assert assembly.grip_frame == GRIP
    assert episode.controllers.shape == (10, 8, 3)
    for frame in (0, GRIP, 9):
        # Also before the contact: the hand is as wide there.
        place = at_depth(given[frame].hands[0].pixel[None], DEPTH, given[frame].view)
        np.testing.assert_allclose(episode.controllers[frame].mean(axis=0), place[0], atol=1e-5)
    around = episode.controllers - episode.controllers.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(around, np.repeat(around[:1], 10, axis=0), atol=1e-6)


def test_two_hands_are_two_groups_from_the_first_contact_on() -> None:
    assembly = assembled(seen(grips=(7, 3)))
    assert assembly.grip_frame == 3
    episode = assembly.episode("drawn", 0.0)
    assert episode.controllers.shape == (10, 8, 3)
    assert len(np.unique(episode.controller_ids)) == 8
    groups = episode.controllers.reshape(10, 2, 4, 3)
    assert np.linalg.norm(groups.mean(axis=2)[:, 0] - groups.mean(axis=2)[:, 1], axis=1).min() > 0.03


def test_a_hand_that_never_touches_has_no_controllers() -> None:
    assert assembled(seen(grips=(None, 3))).episode("drawn", 0.0).controllers.shape == (10, 8, 3)
    nobody = assembled(seen(grips=(None,)))
    assert nobody.grip_frame == -1
    assert nobody.episode("drawn", 0.0).controllers.shape == (10, 0, 3)
    assert assembled(seen(grips=())).episode("drawn", 0.0).controllers.shape == (10, 0, 3)


def test_hand_that_is_lost_goes_straight() -> None:
    given = seen()
    for frame in (6, 7, 8):
        given[frame] = replace(given[frame], hands={})
    episode = assembled(given).episode("drawn", 0.0)
    np.testing.assert_allclose(episode.controllers[7], episode.controllers[[5, 9]].mean(axis=0), atol=1e-4)


def test_hidden_side_is_there_while_it_is_not_too_doubtful() -> None:
    behind = np.random.default_rng(3).uniform(-0.1, 0.1, (30, 3)) + [0, 0, 0.2]
    sure = np.linspace(0.95, 0.05, 10)
    given = [
        replace(each, hidden_points=behind, hidden_confidence=np.full(30, confidence))
        for each, confidence in zip(seen(), sure, strict=True)
    ]
    episode = assembled(given).episode("drawn", 0.0)
    added = episode.points[:, 60:]
    assert added.shape[1] == 30
    np.testing.assert_allclose(added[sure >= 0.2], np.broadcast_to(behind, (8, 30, 3)), atol=1e-6)
    assert np.isnan(added[sure < 0.2]).all()
    np.testing.assert_allclose(
        episode.confidence[:, 60:], np.where(sure >= 0.2, sure, 0)[:, None] * np.ones(30), atol=1e-6
    )


def test_one_view_is_an_error() -> None:
    with pytest.raises(EpisodeError, match="1 view"):
        assembled(seen(1)).episode("drawn", 0.0)


def test_nothing_sure_is_an_error_or_an_episode_that_says_so() -> None:
    given = [replace(each, confidence=np.zeros(len(each.points))) for each in seen()]
    with pytest.raises(EpisodeError):
        assembled(given).episode("drawn", 0.0)


def test_points_that_a_hand_hides_and_holds_go_along_with_it() -> None:
    given = seen(holds=True)
    grip = given[GRIP].hands[0].grip
    nearest = np.argsort(np.linalg.norm(given[GRIP].points - grip, axis=1))[:3]
    for frame in range(GRIP, 10):
        sure = np.ones(len(given[frame].points))
        sure[nearest] = 0.0
        given[frame] = replace(given[frame], confidence=sure)
    options = replace(OPTIONS, object_points=len(given[0].points))
    held = assembled(given, options).episode("drawn", 0.0)
    pushed = assembled([replace(each, hands={0: replace(each.hands[0], holds=False)}) for each in given], options)
    assert np.isfinite(held.points[9]).all()
    hidden = np.isnan(pushed.episode("drawn", 0.0).points[9]).any(axis=1)
    assert hidden.sum() == 3
    moved = held.points[9, hidden] - held.points[GRIP, hidden]
    hand = held.controllers[9].mean(axis=0) - held.controllers[GRIP].mean(axis=0)
    np.testing.assert_allclose(moved, np.broadcast_to(hand, moved.shape), atol=1e-5)
