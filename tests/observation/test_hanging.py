"""Cloth that hangs in two hands from the first frame on, as an arm and a depth camera record it."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.episode import Episode, EpisodeWarning
from egophys_core.errors import EpisodeError
from egophys_core.observation import observe_episode, prepare
from egophys_core.simulation import ContactKind
from tests.identification.synthetic import episode_of

WIDE, HIGH, SIDE = 0.3, 0.7, 8
"""Metres: of the square cloth, and of the corners that are held; points along an edge."""


def recorded(
    seed: int = 0,
    *,
    delay: float = 0.0,
    drift: float = 0.0,
    jitter: float = 0.0,
    noise: float = 0.002,
    swing: float = 0.3,
) -> Episode:
    """A cloth carried to and fro by two corners, 10 frames a second with gaps, its points stamped late and unevenly.

    Args:
        delay: seconds in the middle of the record, and `drift` by how much it grows in each.
        jitter: seconds, standard deviation.
        noise: metres, standard deviation.
        swing: radians to which the cloth lags behind.
    """
    random = np.random.default_rng(seed)
    times = np.cumsum(random.uniform(0.06, 0.16, 110))
    times -= times[0]

    def carried(at: np.ndarray) -> np.ndarray:
        begun = np.clip(at - 1.5, 0.0, None)
        away = np.zeros((len(at), 3))
        away[:, 1] = 0.08 * np.sin(4.0 * begun) * np.minimum(begun, 1.0)
        away[:, 2] = 0.03 * np.sin(2.5 * begun)
        return away

    corners = np.array([[0.0, 0.0, HIGH], [WIDE, 0.0, HIGH]])
    across, down = np.meshgrid(np.linspace(0.0, WIDE, SIDE), np.linspace(0.0, WIDE, SIDE))
    late = delay + drift * (times - times[-1] / 2)
    seen_at = times - late + jitter * random.normal(size=len(times))
    place = carried(seen_at)
    angle = swing * (carried(seen_at - 0.2)[:, 1] - place[:, 1]) / 0.08
    points = np.stack(
        [
            np.broadcast_to(across.ravel(), (len(times), SIDE * SIDE)),
            down.ravel() * np.sin(angle)[:, None],
            HIGH - down.ravel() * np.cos(angle)[:, None],
        ],
        axis=-1,
    )
    points = points + place[:, None] + random.normal(0.0, noise, points.shape)
    points[random.random(points.shape[:2]) < 0.01] = np.nan
    return episode_of(points, corners + carried(times)[:, None], times)


@pytest.mark.parametrize(
    ("delay", "jitter"), [(0.0, 0.0), (0.0, 0.04), (0.33, 0.0), (0.33, 0.04), (-0.5, 0.02), (0.9, 0.0)]
)
@pytest.mark.parametrize("seed", [1, 2])
def test_both_corners_are_held_from_the_first_frame_to_the_last(delay, jitter, seed):
    seen = observe_episode(recorded(seed, delay=delay, jitter=jitter))
    assert seen.delay == pytest.approx(delay, abs=0.03)
    last = seen.episode.frames - 1
    assert [[(each.first, each.last, each.kind) for each in hand.contacts] for hand in seen.hands] == [
        [(0, last, ContactKind.HOLD)],
        [(0, last, ContactKind.HOLD)],
    ]


def test_what_hangs_has_no_table_and_rests_where_it_hangs_before_the_hands_move():
    seen = observe_episode(recorded(3, delay=0.33, noise=0.003))
    assert seen.hangs
    assert seen.episode.ground_height < np.nanmin(seen.episode.points[..., 2]) - 1.0
    assert np.median(seen.at_rest[:, 2].max() - seen.at_rest[:, 2].min()) == pytest.approx(WIDE, abs=0.01)
    assert np.abs(seen.at_rest[:, 1]).max() < 0.01


def test_what_is_held_close_over_the_table_may_touch_it():
    episode = recorded(4)
    low = float(np.nanmin(episode.points[..., 2]))
    assert not observe_episode(replace(episode, ground_height=low - 0.02)).hangs


def test_what_is_said_of_holds_and_table_is_not_looked_for():
    episode = recorded(4)
    standing = replace(episode, controllers=np.repeat(episode.controllers[:1], episode.frames, axis=0))
    low = float(np.nanmin(episode.points[..., 2]))
    assert not any(hand.touches for hand in observe_episode(standing).hands)
    said = observe_episode(replace(standing, held=True, no_table=True, ground_height=low - 0.02))
    assert [[(each.first, each.last) for each in hand.contacts] for hand in said.hands] == [
        [(0, episode.frames - 1)]
    ] * 2
    assert said.hangs


def test_track_is_told_by_where_it_rests_and_not_by_a_first_frame_that_is_shifted_by_a_cell():
    episode = recorded(5, delay=0.3)
    points = episode.points.copy()
    # A mesh that is fitted anew in each frame: all of it one row further in some of them, the first among these.
    for frame in (0, 6, 30, 60):
        points[frame] = np.roll(points[frame].reshape(SIDE, SIDE, 3), 1, axis=0).reshape(-1, 3)
    seen = observe_episode(replace(episode, points=points))
    assert seen.episode.times[0] == 0.0
    assert seen.episode.frames == episode.frames - 1
    right = np.nanmedian(episode.points[2:6], axis=0)
    assert np.nanmax(np.linalg.norm(seen.episode.points[0] - right, axis=1)) < 0.005


def test_points_two_seconds_late_are_refused_with_that_number():
    with pytest.raises(EpisodeError, match=r"follow the hands 2\.0\d s later than recorded; up to 1 s"):
        observe_episode(recorded(6, delay=2.0, jitter=0.02))


def test_clocks_that_drift_apart_are_said():
    with pytest.warns(EpisodeWarning, match=r"drift apart by \+[12]\.\d %"):
        observe_episode(recorded(7, delay=0.3, drift=0.015))


def test_hands_that_never_come_near_are_refused_with_their_distance():
    episode = recorded(8)
    away = replace(episode, controllers=episode.controllers + np.float32([0, 1.0, 0]))
    seen = observe_episode(away)
    with pytest.raises(EpisodeError, match=r"none ever comes nearer to a point of it than [01]\.\d\d m"):
        prepare(seen, seen.at_rest, np.ones(len(seen.at_rest), bool), spacing=0.04)


def test_points_of_two_objects_are_refused():
    episode = recorded(9)
    other = np.repeat(episode.points[:1] + np.float32([0.8, 0, 0]), episode.frames, axis=0)
    both = replace(
        episode,
        points=np.concatenate([episode.points, other], axis=1),
        confidence=np.ones((episode.frames, 2 * SIDE * SIDE), np.float32),
        point_ids=np.arange(2 * SIDE * SIDE, dtype=np.uint32),
    )
    with pytest.raises(EpisodeError, match="of 2 pieces, 50 cm apart"):
        observe_episode(both)
