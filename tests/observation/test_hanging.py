"""Cloth that hangs in two hands from the first frame on, as an arm and a depth camera record it."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.observation import observe_episode
from egophys_core.simulation import ContactKind
from tests.identification.synthetic import episode_of

WIDE, HIGH, SIDE = 0.3, 0.7, 8
"""Metres: of the square cloth, and of the corners that are held; points along an edge."""


def recorded(seed: int = 0, *, delay: float = 0.0, jitter: float = 0.0, noise: float = 0.002, swing: float = 0.3):
    """A cloth carried to and fro by two corners, 10 frames a second with gaps, its points stamped late and unevenly."""
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
    seen_at = times - delay + random.normal(0.0, jitter, len(times)) if jitter else times - delay
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
