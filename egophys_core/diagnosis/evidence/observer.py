"""The twin as an observer: it runs beside the episode and is nudged towards what was seen.

x'' = (twin) + w^2 (y - x) + 2 z w (y' - x'). A free rollout of a soft object drifts away and then tells little; nudged
it stays near for the whole episode, and a force per mass that it lacks shows as a steady offset a / w^2 of the
observations y. This is the prediction-error method with a fixed gain (Ljung, System Identification, 1999, ch. 7): the
offsets, the innovations, are what parameters and effects are fitted to.
"""

import numpy as np

from egophys_core.diagnosis.observed_tracks import ObservedTracks
from egophys_core.diagnosis.tracked_episode import RATE

DAMPING_RATIO = 0.7
"""z: the twin follows without overshoot."""


class TrackNudging:
    """What nudges the nodes of twins towards observed tracks."""

    def __init__(self, tracks: ObservedTracks, times: np.ndarray, *, rate: float = RATE) -> None:
        """Nudge towards tracks seen at `times` [T]."""
        self.tracks, self.times, self.rate = tracks, times, rate
        weights = abs(tracks.weights)
        self.spread = weights.T.tocsr()
        """[N, P]: how much of a track's offset a node takes."""
        self.seen = np.isfinite(tracks.smooth).all(axis=2)
        self.target = np.where(self.seen[..., None], tracks.smooth, 0.0)
        self.speed = np.where(self.seen[..., None], tracks.velocities, 0.0)
        share = (self.spread @ self.seen.T.astype(float)).T
        self.nudged = share > 0
        """[T, N] whether a track pulls at a node."""
        self.mean = np.where(self.nudged, 1.0 / np.maximum(share, 1e-9), 0.0)
        """[T, N]: what makes the sum of tracks that pull at a node their mean."""

    def __call__(self, time: float, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Towards the tracks of the frame at `time`, for nodes [K, N, 3]: accelerations [K, N, 3], drags [N]."""
        frame = int(np.abs(self.times - time).argmin())
        seen = self.seen[frame]
        offset = self.target[frame] - self.tracks.on_twin(positions)
        damping = 2.0 * DAMPING_RATIO * self.rate
        nudge = (self.rate**2 * offset + damping * self.speed[frame]) * seen[:, None]
        flat = nudge.transpose(1, 0, 2).reshape(len(seen), -1)
        accelerations = (self.spread @ flat).reshape(self.spread.shape[0], -1, 3).transpose(1, 0, 2)
        return accelerations * self.mean[frame][:, None], np.where(self.nudged[frame], damping, 0.0)
