"""The object before any hand touches it."""

from collections.abc import Sequence

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.contact import Hand


def observed_at_rest(episode: Episode, hands: Sequence[Hand]) -> tuple[int, np.ndarray]:
    """Frame of the first contact, and [P, 3] metres: mean positions before it of the points seen mostly then."""
    touched = min((hand.first for hand in hands if hand.touches), default=episode.frames)
    still = episode.points[: max(touched, 1)]
    seen_mostly = np.isfinite(still).all(axis=2).mean(axis=0) >= 0.5
    return touched, np.nanmean(still[:, seen_mostly].astype(np.float64), axis=0)
