"""How an object pulls on the hands that hold it, as its tracks say: what slips through a hand goes where it is pulled.

What is off the table pulls by its weight and inertia, what slides over the table by friction. Were all of it taken to
pull straight down, an ellipsoid that slipped at 12 mm/s in a lift and in a pull over the table would seem to at 7.6.
"""

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.observation.mean_path import mean_path

LIFTED = 0.005
"""Metres over where a track was at rest, from which it is off the table."""

FRICTION = 0.5
"""Of what slides over the table, over its weight: a usual number, which only says what share each direction has."""

SLIDES = 0.02
"""m/s, from which all of that friction acts."""


def pulls_of(observation: TrackedEpisode) -> np.ndarray:
    """[T, 3] the pull on all hands together over the weight of the object, whose tracks have equal shares of it."""
    tracks, times = observation.tracks.smooth, observation.episode.times
    seen = np.isfinite(tracks).all(axis=2)
    lifted = seen & (observation.observed.hangs | (tracks[..., 2] - observation.rest[:, 2] > LIFTED))
    acceleration = np.nan_to_num(np.gradient(_velocity(tracks, times), times, axis=0))
    hangs = (lifted.sum(axis=1) / np.maximum(seen.sum(axis=1), 1))[:, None]
    slides = np.nan_to_num(_velocity(np.where(lifted[..., None], np.nan, tracks), times)) * [1.0, 1.0, 0.0]
    rubs = slides / np.maximum(np.linalg.norm(slides, axis=1, keepdims=True), SLIDES)
    return np.asarray(hangs * ([0.0, 0.0, -1.0] - acceleration / GRAVITY) - (1.0 - hangs) * FRICTION * rubs)


def _velocity(tracks: np.ndarray, times: np.ndarray) -> np.ndarray:
    """[T, 3] m/s of the tracks [T, P, 3] on the whole; NaN beside frames without any."""
    return np.asarray(np.gradient(mean_path(tracks), times, axis=0))
