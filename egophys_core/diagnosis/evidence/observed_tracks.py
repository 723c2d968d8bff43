"""Observed tracks beside the nodes of a twin: where a track lies on the twin, and how it moves without its noise."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_coeffs
from scipy.sparse import csr_matrix

from egophys_core.observation import FitProblem
from egophys_core.observation.track_weights import track_weights

SMOOTHING_FRAMES = 7
"""Frames over which positions and velocities of a track are fitted by a parabola."""


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


def observed_tracks(problem: FitProblem, surface: np.ndarray, rest_frames: int) -> ObservedTracks:
    """The tracks of an episode that are seen at rest, between the surface nodes [N] bool nearest to them there."""
    points = problem.episode.points.astype(np.float64)
    still = points[: max(rest_frames, 1)]
    seen = np.isfinite(still).all(axis=2).mean(axis=0) >= 0.5
    tracks = points[:, seen]
    rest = np.nanmean(tracks[: max(rest_frames, 1)], axis=0)
    smooth, velocities = smoothed(tracks, problem.episode.times)
    return ObservedTracks(
        positions=tracks,
        smooth=smooth,
        velocities=velocities,
        weights=track_weights(rest, problem.start.astype(np.float64), np.flatnonzero(surface)),
    )


def smoothed(tracks: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities [T, P, 3] by sliding parabolas over the frames seen; NaN where fewer than half are."""
    frames = len(tracks)
    window = min(SMOOTHING_FRAMES, frames - (1 - frames % 2))
    if window < 3:
        return tracks.copy(), np.gradient(tracks, times, axis=0)
    step = float(np.median(np.diff(times)))
    seen = np.isfinite(tracks).all(axis=2)
    filled = _filled(tracks, seen)
    padded = np.concatenate([np.repeat(filled[:1], window // 2, 0), filled, np.repeat(filled[-1:], window // 2, 0)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, window, axis=0)
    order = min(2, window - 1)
    position, slope = (savgol_coeffs(window, order, deriv=each, delta=step, use="dot") for each in (0, 1))
    near = np.concatenate([np.zeros((window // 2, *seen.shape[1:])), seen, np.zeros((window // 2, *seen.shape[1:]))])
    enough = np.lib.stride_tricks.sliding_window_view(near, window, axis=0).sum(axis=-1) >= window / 2
    smooth, velocities = windows @ position, windows @ slope
    smooth[~enough], velocities[~enough] = np.nan, np.nan
    return smooth, velocities


def _filled(tracks: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Tracks with gaps bridged by straight lines."""
    filled = tracks.copy()
    frames = np.arange(len(tracks))
    for track in np.flatnonzero(~seen.all(axis=0)):
        known = np.flatnonzero(seen[:, track])
        for axis in range(3):
            filled[:, track, axis] = np.interp(frames, known, tracks[known, track, axis]) if len(known) else 0.0
    return filled
