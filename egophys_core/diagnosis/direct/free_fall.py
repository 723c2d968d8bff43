"""How an object falls that nobody holds: gravity, the air and what acts on all of it decide, whatever it is made of.

x'' = a - c |v| v of the mean of the tracks that are seen in all of a fall, however it was let go. A twin says little of
a fall: where it begins a few milliseconds late its offsets are those of a gravity that is less by a tenth, and the loss
of residuals forgives what is off by more than some millimetres.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from egophys_core.constants import GRAVITY
from egophys_core.diagnosis.evidence.residuals import TrackedEpisode
from egophys_core.geometry import rigid_fit

LEAST_S, FEWEST_FRAMES = 0.16, 6
"""Seconds, and frames, of a fall that tell anything."""

LONGEST_S = 0.5
"""Seconds from which on it is no fall from a table."""

FEWEST_TRACKS = 12
"""Seen in all of a fall."""

CLEARANCE_M = 0.02
"""Metres, beside its height as it lay, that its lowest track is above the table at least, as its underside is not
seen."""

RESIDUAL_M = 0.0015
"""Metres, root mean square, that the mean of tracks leaves of a fall at most: what leaves more has landed."""

TURNS_RAD = 0.8
"""By which tracks turn in a fall at most: what is seen of an object goes round the rest of it."""

STEP_S = 0.005
"""Seconds a step of the integration."""


@dataclass(frozen=True, kw_only=True)
class Fall:
    """One fall, as two halves of its tracks tell it."""

    motions: np.ndarray
    """[2, 4] of each half: the acceleration while it is slow, m/s^2, and the deceleration by air over the square of
    its speed, 1/m."""
    widths: np.ndarray
    """[2, 4] standard deviations of these by the noise of the tracks."""


def falls_in(observation: TrackedEpisode) -> list[Fall]:
    """The falls of an episode that last long enough to tell anything."""
    return [found for first in observation.falls if (found := _fall_from(observation, first)) is not None]


def _fall_from(observation: TrackedEpisode, let_go: int) -> Fall | None:
    times, positions = observation.episode.times, observation.tracks.positions
    # Contacts are in the time of the hands, which points may come after.
    first = int(np.searchsorted(times, times[let_go] + observation.delay))
    lowest = observation.episode.ground_height + CLEARANCE_M + float(np.ptp(observation.rest[:, 2]))
    contact = observation.contact.any(axis=1)
    frames = []
    for frame in range(first, len(times)):
        seen = np.isfinite(positions[frame]).all(axis=1)
        landed = not observation.hangs and seen.any() and positions[frame, seen, 2].min() < lowest
        if landed or contact[frame] or times[frame] > times[first] + LONGEST_S:
            break
        if seen.any():
            frames.append(frame)
    if len(frames) < FEWEST_FRAMES or times[frames[-1]] - times[frames[0]] < LEAST_S:
        return None
    falling = positions[frames]
    tracks = np.flatnonzero(np.isfinite(falling).all(axis=(0, 2)))
    if len(tracks) < FEWEST_TRACKS:
        return None
    turn, _ = rigid_fit(*falling[[0, -1]][:, tracks].astype(np.float64))
    if Rotation.from_matrix(turn).magnitude() > TURNS_RAD:
        return None
    since = times[frames] - times[frames[0]]
    halves = [falling[:, tracks[part::2]].mean(axis=1, dtype=np.float64) for part in range(2)]
    found = [motion_of(since, each) for each in halves]
    if max(residual for *_, residual in found) > RESIDUAL_M:
        return None
    return Fall(motions=np.array([motion for motion, *_ in found]), widths=np.array([width for _, width, _ in found]))


def motion_of(times: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """How something falls, [4] as in `Fall`, that is at places [F, 3] metres at times [F] seconds from 0 on; the
    standard deviations [4] of that, and its residual, metres, root mean square."""
    first = (places[1] - places[0]) / (times[1] - times[0])

    def left(unknown: np.ndarray) -> np.ndarray:
        moved = fallen(times, velocity=unknown[:3], motion=unknown[3:])
        off = places - moved
        return np.asarray(off - off.mean(axis=0))

    start = np.array([*first, 0.0, 0.0, -GRAVITY, 0.0])
    scales = np.array([1.0, 1.0, 1.0, GRAVITY, GRAVITY, GRAVITY, 1.0])
    found = least_squares(lambda unknown: left(unknown).ravel(), start, x_scale=scales)
    squares = np.sum(left(found.x) ** 2, axis=1)
    freedom = places.size - len(start) - 3
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * squares.sum() / freedom
    return found.x[3:], np.sqrt(np.diag(covariance)[3:]), float(np.sqrt(squares.mean()))


def fallen(times: np.ndarray, *, velocity: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """[F, 3] metres by which something falls in times [F] seconds, from 0 on.

    Args:
        velocity: [3] m/s, at first.
        motion: [4] as in `Fall`.
    """
    acceleration, drag = motion[:3], motion[3]
    place, speed, now = np.zeros(3), np.asarray(velocity, np.float64), 0.0
    found = []
    for time in times:
        count = int(np.ceil((time - now) / STEP_S - 1e-9))
        step = (time - now) / max(count, 1)
        for _ in range(count):
            # The midpoint method: what it is off by in a fall is below a tenth of a millimetre.
            middle = speed + 0.5 * step * (acceleration - drag * np.linalg.norm(speed) * speed)
            place = place + step * middle
            speed = speed + step * (acceleration - drag * np.linalg.norm(middle) * middle)
        now = time
        found.append(place)
    return np.array(found)
