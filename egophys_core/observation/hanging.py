"""Objects that hang in hands from the first frame on, and never come near a table."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.contact import Hand

TABLE_BELOW = 10.0
"""Metres below the lowest point: where a table is that is not there."""

NEAR_TABLE = 0.05
"""Metres over the table below which an object may touch it, wrinkles and the noise of its points counted in."""


def hangs_free(episode: Episode, hands: Sequence[Hand]) -> bool:
    """Whether a hand holds the object from the first frame on, and nothing of it is ever seen near the table.

    What is seen far below the table says that there is none, either.
    """
    held = any(hand.touches and hand.first == 0 for hand in hands)
    lowest = float(np.nanmin(episode.points[..., 2])) - episode.ground_height
    return held and abs(lowest) > NEAR_TABLE


def without_table(episode: Episode) -> Episode:
    """The episode over a table that is nowhere near: z = 0 may be the floor of the laboratory."""
    return replace(episode, ground_height=float(np.nanmin(episode.points[..., 2])) - TABLE_BELOW)
