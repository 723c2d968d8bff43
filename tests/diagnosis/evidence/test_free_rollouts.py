"""Errors of free rollouts beside what predicts without physics."""

import dataclasses

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.free_rollouts import episode_error, free_errors
from egophys_core.diagnosis.tracked_episode import observe
from tests.diagnosis.rehearsed import episodes, sheet


def test_error_of_points_that_follow_the_hand_stands_beside_those_of_the_twin():
    observation = observe(sheet(), episodes()[0])
    errors = free_errors(observation, [sheet()])[0]
    found = episode_error(observation, errors, errors, fitted=True)
    # A corner is lifted: most of the sheet stays, or follows later, and no point goes as far as the hand does.
    assert found.follow_track_m > 2.0 * found.track_after_m
    # Where all of it goes with the hand to the millimetre, nothing beats that.
    episode = observation.episode
    hand = episode.controllers.mean(axis=1, keepdims=True)
    moved = (observation.rest[None] + (hand - hand[observation.touched])).astype(np.float32)
    moved[: observation.touched] = observation.rest
    carried = dataclasses.replace(
        episode,
        points=moved,
        confidence=np.ones(moved.shape[:2], np.float32),
        point_ids=np.arange(moved.shape[1], dtype=np.uint32),
    )
    problem = dataclasses.replace(observation.problem, episode=carried)
    whole = episode_error(dataclasses.replace(observation, problem=problem), errors, errors, fitted=True)
    assert whole.follow_track_m == pytest.approx(0.0, abs=2e-3)
