"""Hands from what they hold: a lifted sheet tells where the hand was that a camera saw at a wrong depth."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.identification.hand_paths import SolvedHands, solve_hands
from egophys_core.kinds import kind_named
from tests.identification.synthetic import LIFT, STILL, known_model, make_episode, sheet_shape, without

EYE = np.array([0.0, -0.5, 0.6])
"""Metres: of a camera that does not move."""
OFF_M = 0.04
"""Metres along the line of sight by which hands are seen too far or too near, half-way."""
CARRIED_S = LIFT + 0.2
"""Seconds from which on the sheet moves with the hand."""


@cache
def true_episode() -> Episode:
    """A sheet of 20 cm that is lifted at a corner by a whole hand."""
    variants = kind_named("sheet").variants(known_model(sheet_shape(9, 0.025)))
    return make_episode(max(variants, key=lambda model: model.parameters.controller_radius))


def seen_at_wrong_depth(off_m: float) -> Episode:
    """The episode with its hand moved along the line of sight, there and back again while it carries."""
    episode = true_episode()
    to_hand = episode.controllers.mean(axis=1) - EYE
    share = np.clip((episode.times - LIFT) / (STILL - LIFT), 0, 1)
    off = off_m * np.sin(np.pi * share)[:, None] * to_hand / np.linalg.norm(to_hand, axis=1, keepdims=True)
    return replace(episode, controllers=(episode.controllers + off[:, None]).astype(np.float32))


@cache
def solved(off_m: float) -> SolvedHands:
    episode = seen_at_wrong_depth(off_m)
    return solve_hands(episode, np.tile(EYE, (episode.frames, 1)))


def error(episode: Episode) -> float:
    """Metres, mean over the frames in which the sheet is carried, of the hand's motion.

    A hand that held some millimetres beside would move the sheet alike, so that a constant offset does not count.
    """
    off = (episode.controllers - true_episode().controllers).mean(axis=1)[episode.times > CARRIED_S]
    return float(np.linalg.norm(off - off.mean(axis=0), axis=1).mean())


@pytest.mark.parametrize("off_m", [OFF_M, -OFF_M], ids=["too far", "too near"])
def test_what_is_held_brings_the_path_back(off_m: float) -> None:
    found, seen = solved(off_m), seen_at_wrong_depth(off_m)
    assert error(found.episode) < error(seen) / 2.5
    assert found.miss_after_m < 0.5 * found.miss_before_m
    # Half-way it is 40 mm, in the mean over the time in which it holds some 20.
    assert 0.010 < found.moved_m < 0.035


def test_a_path_that_is_right_hardly_changes() -> None:
    assert error(solved(0.0).episode) < 0.006


def test_only_controllers_change_and_they_keep_their_places_among_each_other() -> None:
    seen, found = seen_at_wrong_depth(OFF_M), solved(OFF_M).episode
    np.testing.assert_array_equal(found.points, seen.points)
    np.testing.assert_array_equal(found.times, seen.times)
    np.testing.assert_array_equal(found.controller_ids, seen.controller_ids)
    among = [each.controllers - each.controllers.mean(axis=1, keepdims=True) for each in (found, seen)]
    np.testing.assert_allclose(*among, atol=1e-5)


def test_points_that_are_not_seen_do_not_matter() -> None:
    seen = seen_at_wrong_depth(OFF_M)
    gaps = without(seen, frames=slice(30, 45), points=slice(0, 40))
    found = solve_hands(gaps, np.tile(EYE, (gaps.frames, 1)))
    assert error(found.episode) < error(seen) / 2


def test_a_hand_that_moves_nothing_is_an_error() -> None:
    episode = true_episode()
    away = replace(episode, controllers=episode.controllers + np.float32([0.5, 0, 0.5]))
    with pytest.raises(EpisodeError, match="no hand moves the object"):
        solve_hands(away, np.tile(EYE, (episode.frames, 1)))
