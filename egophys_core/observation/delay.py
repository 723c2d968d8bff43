"""How late, and how surely, object points follow the hands: both are correlated before any contact is looked for.

Hands and points may be recorded by different clocks. At 0.3 m/s a third of a second makes 10 cm, which looks like a
hand that is elsewhere, lets go, or moves nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from egophys_core.episode import Episode
from egophys_core.interpolation import tracks_at
from egophys_core.observation.hand_scene import NEAR_HAND, STEP, steps_of

LARGEST_DELAY_S, LONGEST_S = 1.0, 3.0
"""Object points that lag more than this behind the hands, or run ahead of them, are refused; so far it is looked."""

FINE_S, COARSE_S = 0.05, 0.1
"""Seconds between the delays that are tried, of those that are taken off and of those that are refused. A hand reverses
in no less than four of the fine ones: in swings at 2.2 Hz whose points came 0.05 s late, 0 and 0.1 s were as bad."""

MOST_TRACKS = 64
"""Of the tracks that come nearest to a hand so many are asked."""

FOLLOWED_MORE, FOLLOWED_TIMES = 0.05, 1.2
"""Points are late if with the delay taken off they follow more of the hands' travel: by this share of it, and times
what they follow without. The share is 0.02 and less in 60 recordings without a delay, pushes that roll a toy too, and
0.09 and more with one (docs/notes/contact.md)."""

DRIFTS, DRIFT_DELAYS_S, DRIFT_GAIN = np.arange(-4, 5) * 0.005, np.arange(-3, 4) * 0.03, 0.015
"""Drifts and delays beside the best one that are tried, and by how much more of the hands' travel points must then
follow: 0.005 and less in recorded cloths, 0.02 in half of these where a drift of 0.01 was added; less does no harm."""

FOLLOWS = 0.5
"""Points that miss more of the hand's steps than this (median) are pushed or rest; what is held misses 0.05 to 0.3."""


@dataclass(frozen=True, kw_only=True)
class Following:
    """How an episode's object points follow its hands."""

    delay: float
    """Seconds by which they are recorded later than the hands; 0 where that is not told."""
    drift: float
    """Seconds by which that grows in each second; 0 where that is not told."""
    noise: np.ndarray
    """[hands] metres: what points miss of a step of the hand that they come along with (median); 0 where few do."""


def following(episode: Episode, hands: Sequence[np.ndarray]) -> Following:
    """Correlate points with hands.

    Args:
        hands: for each hand its controllers, indices [H].
    """
    travels = [_Travel(episode, members) for members in hands]
    moving = [each for each in travels if each.length > 0]
    delay = _delay(moving)
    drift = _drift(moving, delay) if delay else 0.0
    return Following(delay=delay, drift=drift, noise=np.array([each.noise(delay) for each in travels]))


def _delay(travels: Sequence["_Travel"]) -> float:
    if not travels:
        return 0.0

    tried = np.union1d(_on_both_sides(LARGEST_DELAY_S, FINE_S), _on_both_sides(LONGEST_S, COARSE_S))
    shares = np.array([_followed(travels, delay) for delay in tried])
    at_once = shares[len(tried) // 2]
    best = float(tried[np.argmax(shares)])
    if shares.max() < max(at_once + FOLLOWED_MORE, FOLLOWED_TIMES * at_once):
        return 0.0

    def missed(delay: float) -> float:
        return -_followed(travels, delay)

    bounds = (best - COARSE_S, best + COARSE_S)
    return float(minimize_scalar(missed, bounds=bounds, method="bounded", options={"xatol": 1e-3}).x)


def _on_both_sides(largest: float, apart: float) -> np.ndarray:
    """Seconds, from the largest delay ahead to that behind, to the millisecond."""
    count = round(largest / apart)
    return np.round(np.arange(-count, count + 1) * apart, 3)


def _drift(travels: Sequence["_Travel"], delay: float) -> float:
    """Seconds by which a delay grows in each second, if points follow clearly better so."""
    near = delay + DRIFT_DELAYS_S
    shares = [max(_followed(travels, each, drift) for each in near) for drift in DRIFTS]
    best = int(np.argmax(shares))
    return float(DRIFTS[best]) if shares[best] >= shares[len(DRIFTS) // 2] + DRIFT_GAIN else 0.0


def _followed(travels: Sequence["_Travel"], delay: float, drift: float = 0.0) -> float:
    """Share of the hands' travel that points near them come along with."""
    return sum(each.followed(delay, drift) for each in travels) / sum(each.length for each in travels)


class _Travel:
    """How a hand moves, and the tracks that ever come near to it."""

    def __init__(self, episode: Episode, members: np.ndarray) -> None:
        self._times = episode.times
        self._fingers = episode.controllers[:, members].astype(np.float64)
        hand = self._fingers.mean(axis=1)
        self._before, self._after = steps_of(self._times, hand).T
        self._steps = hand[self._after] - hand[self._before]
        self._long = np.linalg.norm(self._steps, axis=1)
        spent = self._times[self._after] - self._times[self._before]
        travel = np.where(self._long < STEP, 0.0, self._long * np.gradient(self._times) / spent)
        away = np.linalg.norm(episode.points - hand[:, None], axis=2)
        nearest = np.where(np.isfinite(away), away, np.inf).min(axis=0)
        self._points = episode.points[:, np.argsort(nearest)[:MOST_TRACKS]].astype(np.float64)
        self._travel = travel
        self.length = float(travel.sum())
        """Metres in all."""

    def followed(self, delay: float, drift: float) -> float:
        """Metres of the travel that points near the hand come along with, were they recorded so many seconds late in
        the middle of the record, and later by `drift` with every second."""
        return float((self._travel * np.maximum(1.0 - self._missed(delay, drift), 0.0)).sum())

    def noise(self, delay: float) -> float:
        """Metres, of a hand that points follow: what they miss of a step."""
        missed, long = self._missed(delay)[self._travel > 0], self._long[self._travel > 0]
        came_along = missed[missed < 1.0]
        if not len(came_along) or np.median(came_along) > FOLLOWS:
            return 0.0
        return float(np.median(came_along * long[missed < 1.0]))

    def _missed(self, delay: float, drift: float = 0.0) -> np.ndarray:
        """[T] what points near the hand miss of its step around each frame, over that step; 1 where none is seen."""
        late = delay + drift * (self._times - self._times[-1] / 2.0)
        points = tracks_at(self._times, self._points, self._times + late)
        near = np.zeros(points.shape[:2], bool)
        for finger in range(self._fingers.shape[1]):
            near |= np.linalg.norm(points - self._fingers[:, finger, None], axis=2) < NEAR_HAND
        moved = points[self._after] - points[self._before]
        told = (near[self._before] | near[self._after]) & np.isfinite(moved).all(axis=2)
        count = told.sum(axis=1)
        mean = np.where(told[..., None], moved, 0.0).sum(axis=1) / np.maximum(count, 1)[:, None]
        missed = np.linalg.norm(mean - self._steps, axis=1) / np.maximum(self._long, STEP)
        return np.where(count > 0, missed, 1.0)
