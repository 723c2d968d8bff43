"""A cable between two hands as a curve: markers and held points on it, and how a rod between them moves."""

from dataclasses import replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.kinds.kind import MarkerBody
from egophys_core.kinds.rod import rod_model
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import ObjectModel
from tests.diagnosis.cantilever import still_episode
from tests.kinds.seen_markers import marker_body, place_markers

LENGTH = 0.9
"""Metres of the whole curve."""


def curve(count: int, *, half_turn: float = 1.2, length: float = LENGTH) -> np.ndarray:
    """[count, 3] metres: points at equal arc lengths along an arc of a circle that hangs in the x-z plane."""
    radius = length / (2.0 * half_turn)
    angles = np.linspace(-half_turn, half_turn, count)
    return np.stack([radius * np.sin(angles), np.zeros(count), 1.0 - radius * np.cos(angles)], axis=1)


def record_of(points: np.ndarray, *, held_first: int, held_last: int, frames: int = 60) -> Episode:
    """Places [K, 3] that do not move, of which the first and the last few are held."""
    end = len(points) - held_last
    return still_episode(np.concatenate([points[:held_first], points[end:]]), points[held_first:end], frames=frames)


def rolled_out(model: ObjectModel, body: MarkerBody, episode: Episode, *, from_rest: bool = False) -> np.ndarray:
    """[T, P, 3] metres: where the markers of an episode are as its hands move the model."""
    problem = place_markers(model, body.grasp, episode)
    batch = batch_of_models(
        [model],
        [problem.controls],
        starts=[problem.start],
        velocities=None if from_rest else [problem.velocities],
        ground_height=-10.0,
    )
    result = rollout(batch)
    result.raise_on_failure()
    return result.positions[0][:, problem.bound]


def moved_by_hand(episode: Episode, *, aside: float = 0.0) -> Episode:
    """One hand goes up and down, and to both sides by so many metres; all is at rest before."""
    body = marker_body(episode, None)
    slow = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=8.0)
    at_rest = np.repeat(rolled_out(slow, body, episode)[-1:], episode.frames, axis=0)
    held = episode.controllers.copy()
    moved = 1.0 - np.cos(2.0 * np.pi * 0.9 * episode.times)[:, None].astype(np.float32)
    held[:, 2:, 1:] += moved[..., None] * np.array([aside, 0.08], np.float32)
    return replace(episode, controllers=held, points=at_rest)
