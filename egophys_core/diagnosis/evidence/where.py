"""Where the residual lives: near the hand or far, on the table or in the air, when, and at what speed and strain."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.diagnosis.diagnosis import Where
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.simulation import ContactKind

NEAR_HAND, FAR_FROM_HAND = 0.05, 0.12
"""Metres at rest from where a hand touches: below the first is near, beyond the second far."""

ON_TABLE = 0.01
"""Metres above its rest height below which a track counts as lying on the table."""


def where(observations: Sequence[TrackedEpisode], offsets: Sequence[np.ndarray], law: str) -> Where:
    """Sort offsets [F, P, 3] of each episode, metres, measured minus twin, by place, time, speed and strain.

    Args:
        law: the generic force law found, or empty.
    """
    sizes, distances, heights, speeds, strains = [], [], [], [], []
    worst = {}
    for observation, offset in zip(observations, offsets, strict=True):
        size = np.linalg.norm(offset, axis=2)
        tracks = observation.tracks.positions[observation.touched :]
        rest = observation.rest
        sizes.append(size)
        distances.append(np.broadcast_to(_distance_to_hand(observation, rest), size.shape))
        heights.append(tracks[..., 2] - rest[:, 2])
        speeds.append(np.linalg.norm(observation.tracks.velocities[observation.touched :], axis=2))
        strains.append(_strain(observation.tracks.smooth[observation.touched :], rest))
        over_time = np.array([np.nanmedian(row) if np.isfinite(row).any() else 0.0 for row in size])
        worst[observation.episode.name] = float(observation.episode.times[observation.touched + over_time.argmax()])
    size, distance, height, speed, strain = (
        np.concatenate([each.ravel() for each in values]) for values in (sizes, distances, heights, speeds, strains)
    )
    return Where(
        size_m=_median(size),
        by_region={
            "near the hand": _median(size[distance < NEAR_HAND]),
            "in between": _median(size[(distance >= NEAR_HAND) & (distance < FAR_FROM_HAND)]),
            "far from the hand": _median(size[distance >= FAR_FROM_HAND]),
            "on the table": _median(size[height < ON_TABLE]),
            "in the air": _median(size[height >= ON_TABLE]),
        },
        by_motion={
            **_thirds("speed", speed, size),
            **_thirds("strain", strain, size),
        },
        worst_time_s=worst,
        law=law,
    )


def _distance_to_hand(observation: TrackedEpisode, rest: np.ndarray) -> np.ndarray:
    """[P] metres at rest to the nearest controller point as it first touches."""
    controls = observation.problem.controls
    places = [
        controls.positions[np.argmax(controls.contact[:, point] != ContactKind.NONE), point]
        for point in range(controls.positions.shape[1])
        if controls.contact[:, point].any()
    ]
    return np.asarray(cKDTree(np.array(places)).query(rest)[0])


def _strain(tracks: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """[F, P] mean size of the strain towards the nearest tracks at rest; NaN where they are hidden."""
    count = min(7, len(rest))
    lengths, near = cKDTree(rest).query(rest, k=count)
    there = np.linalg.norm(tracks[:, near[:, 1:]] - tracks[:, :, None], axis=3)
    strain = np.abs(there / np.maximum(lengths[:, 1:], 1e-6) - 1.0)
    seen = np.isfinite(strain).any(axis=2)
    return np.where(seen, np.nansum(strain, axis=2) / np.maximum(np.isfinite(strain).sum(axis=2), 1), np.nan)


def _thirds(name: str, values: np.ndarray, size: np.ndarray) -> dict[str, float]:
    known = np.isfinite(values) & np.isfinite(size)
    if not known.any():
        return {}
    low, high = np.quantile(values[known], [1 / 3, 2 / 3])
    return {f"low {name}": _median(size[values <= low]), f"high {name}": _median(size[values >= high])}


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
