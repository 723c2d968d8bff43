"""How far around a hand what is held comes along, from tracks."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.episode import Episode
from egophys_core.kinds.kind import FIST_RADIUS
from egophys_core.observation import observe_episode
from egophys_core.observation.grasp_radius import grasp_radius

FRAMES, REST = 75, 25


def lifted(held: float, *, fade: float = 0.06, noise: float = 0.0015, off: float = 0.0, unseen: float = 0.0) -> Episode:
    """A sheet of which a disk of some radius goes up with a hand by 0.2 m, and less of what is farther from its edge.

    Args:
        off: metres by which the hand's path is off, slowly changing.
    """
    generator = np.random.default_rng(0)
    axis = np.linspace(-0.15, 0.15, 21)
    rest = np.stack([*np.meshgrid(axis, axis), np.full((21, 21), 0.004)], axis=-1).reshape(-1, 3)
    share = np.clip(1.0 - (np.linalg.norm(rest[:, :2], axis=1) - held) / fade, 0.0, 1.0)
    rise = 0.2 * np.clip((np.arange(FRAMES) - REST) / 40, 0.0, 1.0)
    points = rest + rise[:, None, None] * share[:, None] * [0, 0, 1]
    points += generator.normal(0, noise, points.shape)
    points[5:][generator.random(points[5:].shape[:2]) < unseen] = np.nan
    ball = generator.normal(0, 1, (12, 3))
    ball *= 0.02 / np.linalg.norm(ball, axis=1, keepdims=True)
    reach = np.clip((REST - 5 - np.arange(FRAMES)) / 15, 0.0, 1.0)[:, None] * [0.2, 0, 0.1]
    error = off * np.stack([np.cos(np.arange(FRAMES) / 30), 0 * rise, np.sin(np.arange(FRAMES) / 30)], axis=1)
    middle = [0, 0, 0.01] + reach + rise[:, None] * [0, 0, 1] + error
    return Episode(
        name="lifted",
        times=np.arange(FRAMES) / 30,
        points=points.astype(np.float32),
        confidence=np.isfinite(points).all(axis=2).astype(np.float32),
        controllers=(middle[:, None] + ball).astype(np.float32),
        point_ids=np.arange(len(rest), dtype=np.uint32),
        controller_ids=np.arange(len(ball), dtype=np.uint32),
        ground_height=0.0,
    )


@pytest.mark.parametrize("held", [0.03, 0.04, 0.05])
def test_what_a_hand_holds_is_measured_to_a_track(held):
    # Tracks lie 15 mm apart.
    assert grasp_radius([observe_episode(lifted(held))]) == pytest.approx(held, abs=0.012)


def test_a_hand_that_is_off_and_points_that_are_not_seen_do_not_matter():
    seen = observe_episode(lifted(0.04, off=0.01, noise=0.003, unseen=0.5))
    assert grasp_radius([seen]) == pytest.approx(0.04, abs=0.016)


def test_the_median_of_all_holds_counts():
    episodes = [observe_episode(lifted(held)) for held in (0.03, 0.031, 0.055)]
    assert grasp_radius(episodes) == pytest.approx(grasp_radius(episodes[1:2]), abs=1e-3)


def test_what_comes_along_as_a_whole_tells_nothing():
    assert grasp_radius([observe_episode(lifted(0.4))]) == FIST_RADIUS


def test_without_a_hold_nothing_tells():
    lies = replace(lifted(0.04), points=np.repeat(lifted(0.04).points[:1], FRAMES, axis=0))
    assert grasp_radius([observe_episode(lies)]) == FIST_RADIUS
