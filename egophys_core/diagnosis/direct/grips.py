"""Grips: what a hand holds goes where the hand goes, whatever the object is made of.

So the tracks in a hand say how the record of the hand differs from the truth, and whether the grip slips, before any
physics of the object. The rest of the object hides neither: of the tracks near a hand the few that follow it best are
taken to be held (least trimmed squares; Rousseeuw, J. American Statistical Association 79 (1984) 871).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from egophys_core.diagnosis.direct.pulls import pulls_of
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import effect_named
from egophys_core.effects.effect_values import Values
from egophys_core.effects.hands import turns
from egophys_core.simulation import ContactKind

NEAR = 0.07
"""Metres from a hand's centre within which tracks may be held."""

HELD_TRACKS = 4
"""Tracks that a hand holds; of 200 on a towel about as many lie between its fingers."""

SEEN = 0.3
"""Share of a grip's frames in which a track must be seen."""

CLOSING_S = 0.2
"""Seconds in which a grip closes, or in which a record that is early has the hand hold what it does not hold yet."""

LEAST_GRIP_S = 1.0
"""Seconds after that below which a grip says nothing."""


@dataclass(frozen=True, kw_only=True)
class GripRecord:
    """One hand that holds, and the tracks near it."""

    times: np.ndarray
    """[F] seconds of the frames in which it holds."""
    tracks: np.ndarray
    """[F, P, 3] metres, without most of their noise; NaN where unseen."""
    levers: np.ndarray
    """[P, 3] metres from the hand's centre to each track when it takes hold."""
    record_times: np.ndarray
    """[T] seconds of the whole episode."""
    centres: np.ndarray
    """[T, 3] metres, the hand by its record."""
    turned: np.ndarray
    """[T, 3, 3] how it is turned against when it takes hold, by its record."""
    pulls: np.ndarray
    """[F, 3] how the object pulls on the hands, over its weight."""
    delay: float = 0.0
    """Seconds by which the tracks are late, as far as that was told before."""
    noise: float = 0.0
    """Metres: what points near hands miss of how these move."""

    @property
    def seconds(self) -> float:
        """How long it holds."""
        return float(self.times[-1] - self.times[0])

    def centres_at(self, times: np.ndarray) -> np.ndarray:
        """[F, 3] metres: the hand's centre, by its record at times [F]."""
        return self._recorded(self.centres, times)

    def carried(self, times: np.ndarray) -> np.ndarray:
        """[F, P, 3] metres: how far each track has gone round the hand's centre with it, by the record at times [F]."""
        return np.einsum("fij,pj->fpi", self._recorded(self.turned, times) - np.eye(3), self.levers)

    def _recorded(self, record: np.ndarray, times: np.ndarray) -> np.ndarray:
        """A record [T, ...] at other times [F]; at its ends it stays."""
        after = np.clip(np.searchsorted(self.record_times, times), 1, len(record) - 1)
        before, ahead = self.record_times[after - 1], self.record_times[after]
        share = np.clip((times - before) / (ahead - before), 0.0, 1.0).reshape(-1, *(1,) * (record.ndim - 1))
        return np.asarray(record[after - 1] + share * (record[after] - record[after - 1]))


def grips_of(observation: TrackedEpisode) -> list[GripRecord]:
    """The grips of an episode that last and have tracks near them."""
    tracks, times = observation.tracks.smooth, observation.episode.times
    found, pulls = [], pulls_of(observation)
    for hand in observation.problem.hands:
        fingers = observation.episode.controllers[:, hand.controllers].astype(np.float64)
        centres = fingers.mean(axis=1)
        for contact in hand.contacts:
            closed = int(np.searchsorted(times, times[contact.first] + CLOSING_S))
            frames = slice(closed, contact.last + 1)
            if (
                contact.kind != ContactKind.HOLD
                or times[contact.last] - times[contact.first] < CLOSING_S + LEAST_GRIP_S
            ):
                continue
            levers = _last_seen(tracks, observation.rest, contact.first) - centres[contact.first]
            held = np.linalg.norm(levers, axis=1) < NEAR
            held &= np.isfinite(tracks[frames]).all(axis=2).mean(axis=0) >= SEEN
            if held.sum() < HELD_TRACKS:
                continue
            found.append(
                GripRecord(
                    times=times[frames],
                    tracks=tracks[frames][:, held],
                    levers=levers[held],
                    record_times=times,
                    centres=centres,
                    pulls=pulls[frames],
                    delay=observation.observed.delay,
                    noise=observation.observed.noise,
                    turned=turns(np.concatenate([fingers[contact.first, None], fingers]))[1:],
                )
            )
    return found


def held_displacements(grip: GripRecord, effects: Mapping[str, Values]) -> np.ndarray:
    """[F, P, 3] metres: how far tracks that are held would have gone since the hand took hold.

    The clocks and drives of the effects say where the hand truly was, and their slides what slides through it.

    Args:
        effects: parameters by the name of the effect.
    """
    known = [(effect_named(name), values) for name, values in effects.items()]
    times = grip.times
    for effect, values in known:
        times = effect.clock(values, times) if effect.clock else times
    centres = grip.centres_at(times)
    holds = np.ones((len(times), 1), bool)
    slid = np.zeros((len(times), 3))
    for effect, values in known:
        centres = effect.drive(values, grip.times, centres[:, None], holds)[:, 0] if effect.drive else centres
        if effect.slide:
            steps = effect.slide(values, grip.times[:-1], grip.times[1:], grip.pulls[:-1, None])
            slid[1:] += steps[:, 0].cumsum(axis=0)
    return np.asarray((centres - centres[0] + slid)[:, None] + grip.carried(times))


def residual_of(grip: GripRecord, displacements: np.ndarray) -> np.ndarray:
    """[F, P, 3] metres: tracks less displacements [F, P, 3] and where in the hand they are; 0 where unseen."""
    error = grip.tracks - displacements
    return np.nan_to_num(error - np.nanmean(error, axis=0))


def held(grip: GripRecord, residual: np.ndarray) -> tuple[np.ndarray, float]:
    """The tracks [HELD_TRACKS] that follow best, and the mean square of their residual [F, P, 3], m^2 per axis.

    What is seen half of the time has to follow twice as well.
    """
    seen = np.isfinite(grip.tracks).all(axis=2).mean(axis=0)
    squares = np.mean(residual**2, axis=(0, 2)) / seen**2
    best = np.argsort(squares)[:HELD_TRACKS]
    return best, float(squares[best].mean())


def _last_seen(tracks: np.ndarray, rest: np.ndarray, frame: int) -> np.ndarray:
    """[P, 3] metres: where tracks [T, P, 3] were last seen before a frame, or at rest [P, 3]."""
    seen = np.isfinite(tracks[: frame + 1]).all(axis=2)
    last = frame - np.argmax(seen[::-1], axis=0)
    return np.where(seen.any(axis=0)[:, None], tracks[last, np.arange(tracks.shape[1])], rest)
