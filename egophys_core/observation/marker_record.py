"""Records of a few markers on an object in clamps: from where rollouts can begin, and what is seen there."""

from dataclasses import dataclass, replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.kinds.kind import SeenMarkers
from egophys_core.observation.clamps import clamp_groups, smoothed_clamps, stands_still
from egophys_core.observation.first_motion import first_motion
from egophys_core.observation.hanging import without_table

MOST_MARKERS = 12
"""Tracks up to which an episode is one of markers: fewer than the patches of a seen surface."""

RELEASED_M = 0.004
"""Metres that markers have moved when they are taken to move: more than a clamp that is touched shakes them."""

RELEASED_WITHIN = 0.1
"""Seconds after the start: what begins to move later was not held back at the start."""

CARRIED = 3.0
"""Times as far from their clamp as before that markers never come: a beam that bends stays as far within percents."""


def is_sparse(episode: Episode) -> bool:
    """Whether an episode shows an object at a few markers."""
    return episode.points.shape[1] <= MOST_MARKERS


def marker_record(episode: Episode) -> tuple[Episode, Episode, SeenMarkers]:
    """The record from the first frame that shows all markers on, the part that rollouts are compared with, and what is
    seen where they begin.

    Raises:
        EpisodeError: markers that are never seen all at once.
    """
    record = from_all_seen(episode)
    onset = find_onset(record)
    shown = _from_onset(record, onset)
    hands = shown.controllers.astype(np.float64)
    places, velocities = first_motion(np.concatenate([shown.controllers, shown.points], axis=1), shown.times)
    seen = SeenMarkers(
        name=episode.name,
        clamps=tuple(clamp_groups(episode.controllers)),
        held=record.controllers[0].astype(np.float64),
        tracks=record.points[0].astype(np.float64),
        onset=onset.markers,
        hands=hands,
        smoothed=smoothed_clamps(hands, shown.times),
        places=places,
        velocities=velocities,
    )
    return record, shown, seen


def require_carried(record: Episode, seen: SeenMarkers) -> None:
    """Check that markers stay about as far from their clamp as they are, on what it holds all the time.

    Raises:
        EpisodeError: they do not, as points of a cloth that a hand reaches for.
    """
    frames = record.visible.any(axis=1)
    markers = np.nanmean(record.points[frames], axis=1, dtype=np.float64)
    apart = np.linalg.norm(markers - record.controllers[frames][:, seen.clamps[0]].mean(axis=1), axis=1)
    if apart.max() > CARRIED * apart.min():
        raise EpisodeError(
            f"{seen.name}: its {len(seen.tracks)} tracked points are {100 * apart.min():.0f} cm from the held points "
            f"at times and {100 * apart.max():.0f} cm at others, so no clamp holds them all the time, and so few make "
            f"no surface; track more than {MOST_MARKERS} points all over the object, or at least 4 one after the other "
            "along a rod"
        )


def from_all_seen(episode: Episode) -> Episode:
    """The episode from the first frame on that shows all its markers: they tell how the object lies.

    Raises:
        EpisodeError: no frame but perhaps the last does.
    """
    seen = episode.visible
    first = int(np.argmax(seen.all(axis=1)))
    if not seen[first].all() or first > episode.frames - 2:
        hidden = int(np.argmin(seen.sum(axis=0)))
        raise EpisodeError(
            f"{episode.name}: no frame shows all {seen.shape[1]} markers, and a twin of markers begins with one; leave "
            f"out marker {episode.point_ids[hidden]}, seen in {seen[:, hidden].sum()} of {episode.frames} frames"
        )
    return episode.from_frame(first) if first else episode


@dataclass(frozen=True, kw_only=True)
class Onset:
    """A moment from which an object can be simulated: it is at rest, if only for that moment."""

    frame: int
    """The last frame that is not after it."""
    time: float
    """Seconds."""
    markers: np.ndarray
    """[P, 3] metres, then."""


def find_onset(episode: Episode) -> Onset:
    """The first turning point of what is let go at the start, or the start itself.

    How a hand lets go, and a load that is slack at first, takes some hundredths of a second that no model knows. Where
    the ring-down first turns back speeds are 0 and markers are seen: a parabola through three frames gives both.
    """
    points, times = episode.points.astype(np.float64), episode.times
    displacement = np.linalg.norm(np.nanmean(points - points[0], axis=1), axis=1)
    gone = int(np.argmax(displacement > RELEASED_M))
    start = Onset(frame=0, time=0.0, markers=points[0])
    if gone == 0 or times[gone] > RELEASED_WITHIN or not stands_still(episode.controllers):
        return start
    turns = [
        frame
        for frame in range(gone, episode.frames - 1)
        if displacement[frame - 1] < displacement[frame] >= displacement[frame + 1]
    ]
    if not turns or not np.isfinite(points[turns[0] - 1 : turns[0] + 2]).all():
        return start
    around = slice(turns[0] - 1, turns[0] + 2)
    curve = np.polyfit(times[around] - times[turns[0]], displacement[around], 2)
    turn = float(times[turns[0]] - curve[1] / (2.0 * curve[0])) if curve[0] < 0 else float(times[turns[0]])
    each = np.polyfit(times[around] - turn, points[around].reshape(3, -1), 2)
    return Onset(frame=int(np.searchsorted(times, turn, side="right")) - 1, time=turn, markers=each[2].reshape(-1, 3))


def _from_onset(episode: Episode, onset: Onset) -> Episode:
    """The episode from there on, the moment itself its first frame; without a table."""
    frames = slice(onset.frame, None)
    times, points = episode.times[frames] - onset.time, episode.points[frames].copy()
    times[0], points[0] = 0.0, onset.markers
    # A frame that follows at once would be no frame: it takes the place of the moment.
    if len(times) > 2 and times[1] < 0.05 * times[2]:
        times, points, frames = np.delete(times, 1), np.delete(points, 1, axis=0), slice(onset.frame + 1, None)
    shown = replace(
        episode,
        times=times,
        points=points.astype(np.float32),
        confidence=episode.confidence[frames],
        controllers=episode.controllers[frames],
        contact=None,
    )
    return without_table(shown)
