"""ObservedEpisode: how an object is seen in an episode, and who holds it when; looked at once, for all who ask."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.kinds.kind import SeenMarkers
from egophys_core.observation.at_rest import first_touch, from_rest, observed_at_rest, still_frames
from egophys_core.observation.checks import (
    require_fittable,
    require_on_table,
    require_one_clock,
    require_one_object,
)
from egophys_core.observation.contact import Contact, Hand, contact_flags, see_hands
from egophys_core.observation.hanging import hangs_free, without_table
from egophys_core.observation.marker_record import MOST_MARKERS, is_sparse, marker_record
from egophys_core.observation.release import with_releases
from egophys_core.simulation import ContactKind


@dataclass(frozen=True, kw_only=True)
class ObservedEpisode:
    """An episode that was looked at: its surface, handled on a table, or markers on it, held in clamps."""

    episode: Episode
    """What rollouts are compared with: of markers from where these can begin on, without a table, of what is held at
    the start from where it is seen to rest on."""
    record: Episode
    """The whole handling; of markers from the first frame on that shows all of them."""
    source: Episode
    """As it was recorded."""
    hands: tuple[Hand, ...]
    """Who touches the object of `episode` when; clamps hold it all the time."""
    touched: int
    """Frame of the first contact."""
    still: int = 1
    """Frames before hands move the object, at least 1."""
    falls: tuple[int, ...] = ()
    """Frames from which on nobody holds it and it falls: the moments at which hands let go are frames of their own."""
    at_rest: np.ndarray
    """[P, 3] metres, the object before hands move it: where the points are that are seen mostly then."""
    delay: float = 0.0
    """Seconds by which the points are recorded later than the hands that move them; 0 where that is not told."""
    noise: float = 0.0
    """Metres: what points near hands miss of how these move; 0 where none follow."""
    hangs: bool = False
    """Whether hands hold it from the first frame on, and it never comes near the table: there is none in `episode`."""
    markers: SeenMarkers | None = None
    """What is seen at markers; None of what is seen all over its surface."""
    load: float = 0.0
    """N, the weight of what hangs at the free end of an object with markers."""

    @property
    def name(self) -> str:
        """Of the episode."""
        return self.source.name

    @property
    def is_sparse(self) -> bool:
        """Whether the object is seen at a few markers."""
        return self.markers is not None

    @property
    def contact(self) -> np.ndarray:
        """[T, C] uint8 `ContactKind` of each controller point of `episode`."""
        return contact_flags(self.episode, self.hands)


AnyEpisode = Episode | ObservedEpisode
"""As it was recorded, or looked at already."""


def observe_episode(episode: AnyEpisode, *, load: float = 0.0) -> ObservedEpisode:
    """Look at an episode, unless that was done.

    Args:
        load: N, the weight of what hangs at the free end of an object with markers.

    Raises:
        EpisodeError: no controllers, points in another unit, of several objects, far from the table or of a clock that
            is far from that of the hands, or markers that are never seen all at once.
        OptionsError: a load that is none, or on what is seen all over.
    """
    if isinstance(episode, ObservedEpisode):
        return episode
    if not 0.0 <= load < np.inf:
        raise OptionsError(f"the load of {episode.name} must be newtons, not negative, got {load}")
    require_fittable(episode)
    if is_sparse(episode):
        record, shown, seen = marker_record(episode)
        held = Contact(first=0, last=shown.frames - 1, kind=ContactKind.HOLD)
        hand = Hand(controllers=np.arange(shown.controllers.shape[1]), contacts=(held,))
        return ObservedEpisode(
            episode=shown,
            record=record,
            source=episode,
            hands=(hand,),
            touched=0,
            at_rest=seen.tracks,
            markers=seen,
            load=load,
        )
    if load:
        raise OptionsError(
            f"a load is given for {episode.name}, which shows {episode.points.shape[1]} points; loads and templates "
            f"are for recordings of at most {MOST_MARKERS}: leave it out, or track fewer"
        )
    shown, seen_hands = episode, see_hands(episode)
    require_one_clock(episode.name, seen_hands.delay, seen_hands.drift)
    if first_touch(episode, seen_hands) == 0:
        shown = from_rest(episode, still_frames(episode, seen_hands), seen_hands.delay)
        seen_hands = see_hands(shown)
    hangs = episode.no_table or hangs_free(shown, seen_hands.hands)
    if hangs:
        shown = without_table(shown)
    still = still_frames(shown, seen_hands)
    at_rest = observed_at_rest(shown, still)
    require_one_object(episode.name, at_rest)
    touched = first_touch(shown, seen_hands)
    if touched > 0 and not hangs and len(at_rest):
        require_on_table(episode.name, at_rest, shown.ground_height)
    released = with_releases(shown, seen_hands.hands, seen_hands.delay)
    return ObservedEpisode(
        episode=released.episode,
        record=released.episode,
        source=episode,
        hands=released.hands,
        falls=released.falls,
        touched=touched,
        still=still,
        at_rest=at_rest,
        delay=seen_hands.delay,
        noise=seen_hands.noise,
        hangs=hangs,
    )


def observe_episodes(episodes: Sequence[AnyEpisode], loads: Mapping[str, float] | None = None) -> list[ObservedEpisode]:
    """Look at episodes of one object, all seen alike.

    Args:
        loads: N that hang at the free end of an object with markers, by name of the episode.

    Raises:
        EpisodeError: as `observe_episode`, or some show a surface and some markers.
        OptionsError: as `observe_episode`, or a load for no episode.
    """
    hung = dict(loads or {})
    names = [each.name for each in episodes]
    for name in hung:
        if name not in names:
            raise OptionsError(f"a load is given for {name}, which is not among the episodes {', '.join(names)}")
    found = [observe_episode(each, load=hung.get(name, 0.0)) for each, name in zip(episodes, names, strict=True)]
    sparse = [name for name, each in zip(names, found, strict=True) if each.is_sparse]
    if 0 < len(sparse) < len(found):
        others = ", ".join(name for name in names if name not in sparse)
        raise EpisodeError(
            f"{', '.join(sparse)}: at most {MOST_MARKERS} points, taken for markers, but {others}: more; give "
            "recordings of one object that all show its surface, or all its markers"
        )
    return found
