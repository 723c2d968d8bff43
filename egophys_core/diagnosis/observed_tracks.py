"""Observed tracks beside the nodes of a twin: where a track lies on the twin, and how it moves without its noise."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from egophys_core.observation import FitProblem, ObservedEpisode
from egophys_core.observation.track_weights import track_weights

SMOOTHING_S, FEWEST_FRAMES, MOST_FRAMES = 0.23, 5, 7
"""Seconds over which positions and velocities of a track are fitted by a parabola, and in how many frames at least and
at most."""


@dataclass(frozen=True, kw_only=True)
class ObservedTracks:
    """The tracks of one episode that lie on the twin."""

    positions: np.ndarray
    """[T, P, 3] metres, as measured, NaN where unseen."""
    smooth: np.ndarray
    """[T, P, 3] metres, NaN where too little is seen around a frame."""
    velocities: np.ndarray
    """[T, P, 3] m/s, NaN where `smooth` is."""
    weights: csr_matrix
    """[P, N]: a track lies at the weighted mean of nodes; rows sum to 1."""

    def on_twin(self, nodes: np.ndarray) -> np.ndarray:
        """[F, P, 3] metres: where the twin has the tracks, from its nodes [F, N, 3]."""
        frames, count = nodes.shape[:2]
        flat = nodes.transpose(1, 0, 2).reshape(count, -1)
        return (self.weights @ flat).reshape(-1, frames, 3).transpose(1, 0, 2)


def observed_tracks(problem: FitProblem, surface: np.ndarray, observed: ObservedEpisode) -> ObservedTracks:
    """The tracks of an episode that are seen at rest, between the surface nodes [N] bool nearest to them there."""
    points, rest = problem.episode.points.astype(np.float64), observed.at_rest
    tracks = points[:, np.isfinite(points[: observed.still]).all(axis=2).mean(axis=0) >= 0.5]
    smooth, velocities = smoothed(tracks, problem.episode.times)
    return ObservedTracks(
        positions=tracks,
        smooth=smooth,
        velocities=velocities,
        weights=track_weights(rest, problem.start.astype(np.float64), np.flatnonzero(surface)),
    )


def smoothed(tracks: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities [T, P, 3] by sliding parabolas over the frames seen; NaN where fewer than half are."""
    frames, step = len(tracks), float(np.median(np.diff(times)))
    wanted = min(max(round(SMOOTHING_S / step), FEWEST_FRAMES), MOST_FRAMES)
    window = min(wanted - (1 - wanted % 2), frames - (1 - frames % 2))
    if window < 3:
        return tracks.copy(), np.gradient(tracks, times, axis=0)
    seen = np.isfinite(tracks).all(axis=2)
    filled = _filled(tracks, seen)
    padded = np.concatenate([np.repeat(filled[:1], window // 2, 0), filled, np.repeat(filled[-1:], window // 2, 0)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, window, axis=0)
    position, slope = _parabolas(times, window, step)
    near = np.concatenate([np.zeros((window // 2, *seen.shape[1:])), seen, np.zeros((window // 2, *seen.shape[1:]))])
    enough = np.lib.stride_tricks.sliding_window_view(near, window, axis=0).sum(axis=-1) >= window / 2
    smooth, velocities = (np.einsum("tpxw,tw->tpx", windows, each) for each in (position, slope))
    smooth[~enough], velocities[~enough] = np.nan, np.nan
    return smooth, velocities


def _parabolas(times: np.ndarray, window: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """[T, W] each: weights of the frames around each for the value and the slope there of a parabola through them.

    Frames may come unevenly. Beyond the ends, where the first and the last one are repeated, they come in steps.
    """
    beyond = step * np.arange(1, window // 2 + 1)
    padded = np.concatenate([times[0] - beyond[::-1], times, times[-1] + beyond])
    since = np.lib.stride_tricks.sliding_window_view(padded, window) - times[:, None]
    fits = np.linalg.pinv(np.stack([np.ones_like(since), since, since**2], axis=-1))
    return fits[:, 0], fits[:, 1]


def _filled(tracks: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Tracks with gaps bridged by straight lines."""
    filled = tracks.copy()
    frames = np.arange(len(tracks))
    for track in np.flatnonzero(~seen.all(axis=0)):
        known = np.flatnonzero(seen[:, track])
        for axis in range(3):
            filled[:, track, axis] = np.interp(frames, known, tracks[known, track, axis]) if len(known) else 0.0
    return filled
