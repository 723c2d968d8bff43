"""How an object falls that nobody holds: gravity, the air and what acts on all of it decide, whatever it is made of.

x'' = a - c |v| v of the middle of a solid, and (1 + r <n n^T>) x'' = a - c |v| v of that of a sheet, which carries air
along its normals n; however it was let go. A twin says little of a fall: where
it begins a few milliseconds late its offsets are those of a gravity that is less by a tenth, and the loss of residuals
forgives what is off by more than some millimetres.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from egophys_core.constants import GRAVITY
from egophys_core.diagnosis.direct.seen_shape import normal_products, seen_sheet, seen_solid
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.geometry import rigid_fit
from egophys_core.kinds.surface_faces import faces_of_sheet

LEAST_S, FEWEST_FRAMES = 0.16, 6
"""Seconds, and frames, of a fall that tell anything."""

LONGEST_S = 0.5
"""Seconds from which on it is no fall from a table."""

CLEARANCE_M = 0.02
"""Metres, beside its height as it lay, that its lowest track is above the table at least, as its underside is not
seen."""

RESIDUAL_M = 0.0015
"""Metres, root mean square, that both halves leave alike of a fall at most: what leaves more has landed. What they
leave otherwise is noise of their tracks."""

TURNS_RAD = 2.0
"""By which a solid turns in a fall at most: what is seen of it then is not what was seen before."""

MIDDLE_M = 0.01
"""Metres (standard deviation) from the middle of a solid to where its mass is in the mean, about which it turns. A
quarter of its mass added at one end moves that by as much."""

NOISE_M = 1e-4
"""Metres (standard deviation) to which a middle is known at best."""

SWING = 3.0
"""Times the standard deviations that noise alone would have, of what both halves of a sheet leave: how it swings about
its middle, which goes on from frame to frame. Of 16 falls of sheets with 0.85 of their mass added at a place, seven
gain 8 at most for an effect that is not there, and nine swing too much to tell anything."""

RANGES = np.array([5.0, 5.0, 5.0, 2.0 * GRAVITY, 2.0 * GRAVITY, 2.0 * GRAVITY, 50.0, 3.0])
"""[8] of a velocity and a motion as of `Fall`, standard deviations of what there is: what a fall does not tell is
within."""

LEAST_CARRIED = -0.8
"""Air over the mass, as far as its lack is a matter of noise."""

STEP_S = 0.005
"""Seconds a step of the integration."""


@dataclass(frozen=True, kw_only=True)
class Fall:
    """One fall, as two halves of its tracks tell it."""

    motions: np.ndarray
    """[2, 5] of each half: the acceleration of what is slow and carries nothing, m/s^2; the deceleration by air over
    the square of its speed, 1/m; the air that it carries along its normals, over its mass, 0 of a solid."""
    covariances: np.ndarray
    """[2, 5, 5] of these, by noise of the tracks, and how it swings or turns."""


def falls_in(observation: TrackedEpisode, *, lies_flat: bool) -> list[Fall]:
    """The falls of an episode that last long enough to tell anything.

    Args:
        lies_flat: whether the object is a sheet.
    """
    return [
        fall
        for first in observation.observed.falls
        if (frames := _frames_of_fall(observation, first)) is not None
        and (halves := _halves_of_tracks(observation, frames, lies_flat=lies_flat)) is not None
        and (fall := _fall(halves)) is not None
    ]


@dataclass(frozen=True, kw_only=True)
class _HalvesOfTracks:
    """What two halves of the tracks say of where something is that falls."""

    times: np.ndarray
    """[F] seconds from the first on."""
    middles: np.ndarray
    """[2, F, 3] metres of each, its middle."""
    normals: np.ndarray
    """[F, 3, 3] which way a sheet faces, as by `normal_products`; 0 of a solid."""
    turns: float
    """Radians a second, of a solid; 0 of a sheet."""
    swing: float
    """Times the standard deviations that noise alone would have, of what both leave."""


def _frames_of_fall(observation: TrackedEpisode, let_go: int) -> np.ndarray | None:
    """Frames in which something is seen, from when it was let go until it lands; None where they are too few."""
    times, positions = observation.episode.times, observation.tracks.positions
    # Contacts are in the time of the hands, which points may come after.
    first = int(np.searchsorted(times, times[let_go] + observation.observed.delay))
    lowest = observation.episode.ground_height + CLEARANCE_M + float(np.ptp(observation.rest[:, 2]))
    contact = observation.observed.contact.any(axis=1)
    frames = []
    for frame in range(first, len(times)):
        seen = np.isfinite(positions[frame]).all(axis=1)
        landed = not observation.observed.hangs and seen.any() and positions[frame, seen, 2].min() < lowest
        if landed or contact[frame] or times[frame] > times[first] + LONGEST_S:
            break
        if seen.any():
            frames.append(frame)
    return np.array(frames) if _tells(times[frames]) else None


def _tells(times: np.ndarray) -> bool:
    """Whether a fall that is seen at times [F] seconds lasts long enough."""
    return bool(times.size >= FEWEST_FRAMES and np.ptp(times) >= LEAST_S)


def _halves_of_tracks(observation: TrackedEpisode, frames: np.ndarray, *, lies_flat: bool) -> _HalvesOfTracks | None:
    """The middle of the object in those of frames [F] in which enough of it is seen; None where these are too few, or
    a solid turns too far."""
    nodes, rest = observation.problem.start.astype(np.float64), observation.rest
    falling = observation.tracks.positions[frames]
    where = seen_sheet if lies_flat else seen_solid
    places = np.array([where(nodes, rest[part::2], falling[:, part::2]) for part in range(2)])
    known = np.isfinite(places).all(axis=(0, 2, 3))
    times, places = observation.episode.times[frames[known]], places[:, known]
    if not _tells(times):
        return None
    if lies_flat:
        normals, turned, swing = normal_products(places, faces_of_sheet(nodes)).mean(axis=0), 0.0, SWING
    else:
        normals, turned, swing = np.zeros((times.size, 3, 3)), _turned(places.mean(axis=0)), 1.0
    if turned > TURNS_RAD:
        return None
    return _HalvesOfTracks(
        times=times - times[0],
        middles=places.mean(axis=2),
        normals=normals,
        turns=turned / float(np.ptp(times)),
        swing=swing,
    )


def _turned(places: np.ndarray) -> float:
    """Radians by which nodes at [F, N, 3] turn from the first to the last frame."""
    turn, _ = rigid_fit(places[0], places[-1])
    return float(Rotation.from_matrix(turn).magnitude())


def _fall(halves: _HalvesOfTracks) -> Fall | None:
    """How something falls, as its halves tell it; None where it does not fall freely."""
    found = [motion_of(halves.times, each, halves.normals) for each in halves.middles]
    left = np.array([each for *_, each in found])
    # What both halves leave alike is how it swings; what they leave otherwise is noise of their tracks.
    noise = np.sum((left[1] - left[0]) ** 2) / 2.0
    swing = max(np.sum(left**2) / 2.0 - noise, 0.0)
    if np.sqrt(swing / halves.times.size) > RESIDUAL_M:
        return None
    # A middle is given by as many numbers as it has coordinates, less those that are fitted to them.
    free = halves.times.size * 3 - len(RANGES) - 3
    variance = max((noise + halves.swing**2 * swing) / free, NOISE_M**2)
    # What turns about another place than its middle pulls that towards it.
    towards = np.diag([*3 * [(MIDDLE_M * halves.turns**2) ** 2], 0.0, 0.0])
    return Fall(
        motions=np.array([motion for motion, *_ in found]),
        covariances=variance * np.array([covariance for _, covariance, _ in found]) + towards,
    )


def motion_of(times: np.ndarray, places: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How something falls, [5] as in `Fall`, that is at places [F, 3] metres at times [F] seconds from 0 on; the
    covariance [5, 5] of that by places that are known to a metre; and the residuals [F, 3], metres.

    Args:
        normals: [F, 3, 3] which way a sheet faces then; 0 of what carries no air.
    """
    first = (places[1] - places[0]) / (times[1] - times[0])
    start = np.array([*first, 0.0, 0.0, -GRAVITY, 0.0, 0.0])

    def left(unknown: np.ndarray) -> np.ndarray:
        velocity, motion = np.split(unknown, [3])
        off = places - fallen(times, velocity=velocity, motion=motion, normals=normals)
        return np.asarray(off - off.mean(axis=0))

    def off(unknown: np.ndarray) -> np.ndarray:
        return np.append(left(unknown).ravel(), NOISE_M * (unknown - start) / RANGES)

    # What carries less than nothing has no mass left at some facing.
    lowest = np.array([*7 * [-np.inf], LEAST_CARRIED])
    found = least_squares(off, start, x_scale=RANGES, bounds=(lowest, np.inf))
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    return found.x[3:], covariance[3:, 3:], left(found.x)


def fallen(times: np.ndarray, *, velocity: np.ndarray, motion: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """[F, 3] metres by which something falls in times [F] seconds, from 0 on.

    Args:
        velocity: [3] m/s, at first.
        motion: [5] as in `Fall`.
        normals: [F, 3, 3] which way a sheet faces then; 0 of what carries no air.
    """
    acceleration, drag, carried = motion[:3], motion[3], motion[4]
    place, speed, now = np.zeros(3), np.asarray(velocity, np.float64), 0.0
    between = np.concatenate([normals[:1], 0.5 * (normals[:-1] + normals[1:])])
    lighter = np.linalg.inv(np.eye(3) + carried * between)
    found = []
    for time, moved in zip(times, lighter, strict=True):
        count = int(np.ceil((time - now) / STEP_S - 1e-9))
        step = (time - now) / max(count, 1)
        for _ in range(count):
            # The midpoint method: what it is off by in a fall is below a tenth of a millimetre.
            middle = speed + 0.5 * step * moved @ (acceleration - drag * np.linalg.norm(speed) * speed)
            place = place + step * middle
            speed = speed + step * moved @ (acceleration - drag * np.linalg.norm(middle) * middle)
        now = time
        found.append(place)
    return np.array(found)
