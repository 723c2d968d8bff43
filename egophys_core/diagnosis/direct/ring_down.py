"""Ring-downs: what is let go in a clamp that stands still swings in one mode, and sinks as its material relaxes.

One mode is an oscillator whatever the object's shape, mass and mount are, so what is slow in its material shows without
any twin. Each record has an oscillator of its own; only what relaxes is the same in all of them.
"""

from dataclasses import dataclass

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.clamps import stands_still
from egophys_core.observation.marker_record import find_onset

LEAST_CROSSINGS = 6
"""Times that a ring-down passes its middle, at least: fewer do not tell how fast it is."""


@dataclass(frozen=True, kw_only=True)
class RingDown:
    """One record along the direction of most motion, from when it first turned back, at rest for that moment."""

    times: np.ndarray
    """[F] seconds since then, the first 0."""
    places: np.ndarray
    """[F] metres, over all markers alike."""
    earlier_times: np.ndarray
    """[E] seconds, negative, from when it was let go."""
    earlier: np.ndarray
    """[E] metres."""

    @property
    def crossings(self) -> np.ndarray:
        """[Z] seconds at which it passes its middle; noise at the end may pass it, too."""
        beside = self.places - np.median(self.places[len(self.places) // 2 :])
        return self.times[:-1][beside[:-1] * beside[1:] < 0.0]

    @property
    def rate(self) -> float:
        """rad/s, about."""
        return float(np.pi / np.median(np.diff(self.crossings[: 2 * LEAST_CROSSINGS])))


def ring_down_of(episode: Episode) -> RingDown | None:
    """The ring-down of an episode whose object is let go at the start, held by a clamp that stands still; else None."""
    onset = find_onset(episode)
    if onset.time == 0.0 or not stands_still(episode.controllers):
        return None
    seen = np.isfinite(episode.points).all(axis=(1, 2))
    times, points = episode.times[seen], episode.points[seen].astype(np.float64)
    after = times > onset.time
    if after.sum() < 3 * LEAST_CROSSINGS or after.all():
        return None
    middle = points[after].mean(axis=0)
    directions = np.linalg.svd((points[after] - middle).reshape(after.sum(), -1), full_matrices=False)[2]
    direction = directions[0] / np.sqrt(points.shape[1])
    places = (points - middle).reshape(len(points), -1) @ direction
    record = RingDown(
        times=np.concatenate([[0.0], times[after] - onset.time]),
        places=np.concatenate([[(onset.markers - middle).ravel() @ direction], places[after]]),
        earlier_times=times[~after] - onset.time,
        earlier=places[~after],
    )
    return record if len(record.crossings) >= LEAST_CROSSINGS else None
