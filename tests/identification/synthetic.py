"""Episodes made by the simulator from a known model: a hand comes, takes hold, lifts and carries the object off."""

from functools import cache

import numpy as np

from egophys_core.episode import Episode
from egophys_core.kinds import kind_named
from egophys_core.kinds.kind import RestShape, Searched
from egophys_core.kinds.rest_shape import surface_model
from egophys_core.simulation import Controls, batch_of_models, rollout
from egophys_core.twin import ObjectModel
from tests.simulation.scenes import frame_times, sheet_positions

FPS = 1 / 30
ARRIVAL, LIFT, STILL = 0.4, 0.6, 2.0
"""Seconds: the hand reaches the object, begins to lift it, and stops moving."""
SPACING = 0.04
HEIGHT = 0.004


def sheet_shape(side: int = 5, spacing: float = SPACING) -> RestShape:
    """The sheet at rest."""
    positions = sheet_positions(side, spacing, HEIGHT)
    return RestShape(positions=positions, surface=np.ones(side * side, bool), kind="sheet", spacing=spacing)


def searched_numbers(kind: str) -> tuple[Searched, ...]:
    """What the coarse fit searches of a kind."""
    return surface_model(kind_named(kind)).searched


def candidate(shape: RestShape, coordinates: np.ndarray) -> ObjectModel:
    """The model at normalised coordinates, over a table at z = 0."""
    return surface_model(kind_named(shape.kind)).candidate(shape, coordinates, ground_height=0.0)


def known_model(shape: RestShape | None = None, **normalised: float) -> ObjectModel:
    """The model that the search would find at known normalised coordinates 0..1; others are those of its start."""
    shape = shape or sheet_shape()
    coordinates = [normalised.get(number.name, number.start_u) for number in searched_numbers(shape.kind)]
    return candidate(shape, np.array(coordinates))


def hand_path(times: np.ndarray, *, grasp: np.ndarray, carry: np.ndarray) -> np.ndarray:
    """[T, 3, 3] metres: three finger points that come down from 20 cm above, wait and carry."""
    fingers = grasp + np.array([[0.012, 0, 0.008], [-0.012, 0, 0.008], [0, 0.015, 0.008]])
    down = np.clip((ARRIVAL - times) / ARRIVAL, 0, 1)[:, None, None] * [0.05, 0, 0.2]
    share = np.clip((times - LIFT) / (STILL - LIFT), 0, 1)
    smooth = share**2 * (3 - 2 * share)
    return fingers + down + smooth[:, None, None] * carry


def make_episode(
    model: ObjectModel,
    *,
    name: str = "synthetic",
    start: np.ndarray | None = None,
    duration: float = 2.2,
    carry: tuple[float, float, float] = (0.06, 0.04, 0.12),
    noise_m: float = 0.0,
    ground_height: float = 0.0,
) -> Episode:
    """Roll the model out under the hand and observe its surface nodes."""
    times = frame_times(duration, FPS)
    rest = model.graph.positions if start is None else start
    grasp = rest[np.argmax(rest[:, 0] + rest[:, 1])]
    path = hand_path(times, grasp=grasp, carry=np.array(carry)).astype(np.float32)
    hold = np.repeat((times >= ARRIVAL - 1e-9)[:, None], 3, axis=1)
    controls = Controls(times=times, positions=path, contact=hold)
    result = rollout(batch_of_models([model], [controls], starts=[rest], ground_height=ground_height))
    result.raise_on_failure()
    points = result.positions[0][:, model.graph.surface]
    noise = np.random.default_rng(0).normal(0, noise_m, points.shape) if noise_m else 0.0
    return episode_of(points + noise, path, times, name=name, ground_height=ground_height)


def episode_of(
    points: np.ndarray,
    controllers: np.ndarray,
    times: np.ndarray | None = None,
    *,
    name: str = "synthetic",
    ground_height: float = 0.0,
) -> Episode:
    """An episode of points [T, N, 3] and controllers [T, C, 3] at 30 Hz."""
    points = np.asarray(points, np.float32)
    return Episode(
        name=name,
        times=frame_times((len(points) - 1) * FPS, FPS) if times is None else times,
        points=points,
        confidence=np.isfinite(points).all(axis=2).astype(np.float32),
        point_ids=np.arange(points.shape[1], dtype=np.uint32),
        controllers=np.asarray(controllers, np.float32),
        controller_ids=np.arange(controllers.shape[1], dtype=np.uint32),
        ground_height=ground_height,
    )


@cache
def sheet_episode() -> Episode:
    """One episode of the sheet, for tests that need any good episode."""
    return make_episode(known_model())


def without(episode: Episode, *, frames: slice, points: slice) -> Episode:
    """The episode with some points not seen in some frames."""
    hidden = episode.points.copy()
    hidden[frames, points] = np.nan
    return episode_of(hidden, episode.controllers, episode.times, name=episode.name)
