"""Errors of free rollouts, before and after: what an effect is worth to whoever predicts with the twin."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.diagnosis.diagnosis import PredictionErrors
from egophys_core.diagnosis.direct.mounting import as_mounted
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.evaluation import chamfer_per_frame, lagging_prediction, track_error_per_frame
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import ObjectModel


@dataclass(frozen=True, kw_only=True)
class FreeErrors:
    """One model on one episode, from first contact on; metres per frame of the whole episode, nan before."""

    track: np.ndarray
    """[T]."""
    chamfer: np.ndarray
    """[T]."""
    last_residual_track: np.ndarray
    """[T], with the mean offset of the tracks at the last train frame taken off from there on."""


def free_errors(observation: TrackedEpisode, models: Sequence[ObjectModel]) -> list[FreeErrors]:
    """Roll each model out freely under the hands of an episode; all infinite where it diverges.

    What was mounted anew for the record is compared as it is mounted there, with every model alike.
    """
    problem = observation.problem
    episode = problem.episode
    batch = batch_of_models(
        models,
        [observation.controls()] * len(models),
        starts=[problem.start] * len(models),
        velocities=[problem.velocities] * len(models),
        ground_height=episode.ground_height,
    )
    result = rollout(batch)
    observed = episode.points[observation.touched :]
    train = episode.train_frames - observation.touched
    clamp = episode.controllers[0].mean(axis=0).astype(np.float64)
    found = []
    for model, positions in zip(models, result.positions, strict=True):
        surface = positions[:, model.graph.surface]
        lost = ~np.isfinite(surface).all(axis=(1, 2))
        surface = np.where(lost[:, None, None], 1e3, surface)
        if observation.mounted and not lost.any():
            surface = as_mounted(surface, problem.bound, observed, clamp, train)
        track = track_error_per_frame(surface, observed, problem.bound)
        chamfer = chamfer_per_frame(surface, observed)
        held = _held(surface, observed, problem.bound, train)
        track[lost], chamfer[lost], held[lost] = np.inf, np.inf, np.inf
        quiet = np.full(observation.touched, np.nan)
        found.append(
            FreeErrors(
                track=np.concatenate([quiet, track]),
                chamfer=np.concatenate([quiet, chamfer]),
                last_residual_track=np.concatenate([quiet, held]),
            )
        )
    return found


def _held(surface: np.ndarray, observed: np.ndarray, bound: np.ndarray, last: int) -> np.ndarray:
    """[F] track error when each track keeps, after frame `last`, the residual it had there."""
    tracks = np.flatnonzero(bound >= 0)
    offset = observed[:, tracks] - surface[:, bound[tracks]]
    known = np.nan_to_num(offset[last - 1])
    left = offset.copy()
    left[last:] -= known
    distance = np.linalg.norm(left, axis=2)
    seen = np.isfinite(distance)
    return np.where(
        seen.any(axis=1), np.where(seen, distance, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1), np.nan
    )


def episode_error(
    observation: TrackedEpisode, before: FreeErrors, after: FreeErrors, *, fitted: bool
) -> PredictionErrors:
    """Means over all frames from first contact on, metres."""
    episode = observation.episode
    follows = lagging_prediction(episode, observation.observed.contact)
    without_physics = track_error_per_frame(follows, episode.points, np.arange(episode.points.shape[1]))
    return PredictionErrors(
        episode=episode.name,
        track_before_m=float(np.nanmean(before.track)),
        track_after_m=float(np.nanmean(after.track)),
        chamfer_before_m=float(np.nanmean(before.chamfer)),
        chamfer_after_m=float(np.nanmean(after.chamfer)),
        last_residual_track_m=float(np.nanmean(before.last_residual_track)),
        follow_track_m=float(np.nanmean(without_physics[max(observation.touched, 1) :])),
        fitted=fitted,
    )
