"""When each hand holds the object or only presses against it: as recorded, or found from what the points near it do.

What was measured and how the thresholds were chosen: docs/notes/contact.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.delay import Following, following
from egophys_core.observation.hand_scene import HandScene, look_at_hand
from egophys_core.simulation import ContactKind

HAND_GAP = 0.15
"""Metres: controller points that never come this near to each other belong to different hands."""

MOVED = 0.5
"""Steps (`HandScene.step_m`, 10 mm or more) that points come along with a hand before it has contact; less is noise."""

LOST = 2.0
"""Steps that a hand moves without the points it held, or they without it, before it has let go."""

SWUNG = 0.75
"""Steps of these that what hangs may move against a hand that stands still, as it swings out, and is held on."""

PULLED = 3.0
"""Steps: a hand that draws points this far that are not ahead of it holds them. A squeezed toy springs back less."""

AHEAD = 0.2
"""Mean cosine between the hand's displacement and the directions to points: above it they are ahead, may be pushed."""

SETTLED, SETTLED_NOISES = 0.006, 3.0
"""Metres, and over the noise of points near it: a hand no farther than this from where it held has arrived, or not yet
left. Soft objects give that much."""

TOUCHED = 0.2
"""Part of the hand's displacement by which points of a soft object come along when the hand begins to move them."""

SEPARATED = 0.01
"""Metres that a pressing hand moves off the surface before it touches no more."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Frames over which a hand acts on the object without a break."""

    first: int
    """First frame; rest lengths are those of this frame."""
    last: int
    """Last frame, at least `first`."""
    kind: ContactKind
    """HOLD moves the points near the hand with it in every direction, PRESS only pushes them ahead."""


@dataclass(frozen=True, kw_only=True)
class Hand:
    """Controller points that move together, and when they act on the object."""

    controllers: np.ndarray
    """[H] int, indices into the episode's controllers."""
    contacts: tuple[Contact, ...]
    """In order of time, without overlap; empty if this hand never moves the object."""

    @property
    def touches(self) -> bool:
        """Whether there is a contact at all."""
        return len(self.contacts) > 0

    @property
    def first(self) -> int:
        """First frame of the first contact, of a hand that touches."""
        return self.contacts[0].first


@dataclass(frozen=True, kw_only=True)
class SeenHands:
    """The hands of an episode, and how late its points follow them."""

    hands: tuple[Hand, ...]
    """In order of their first controller."""
    delay: float
    """Seconds by which points are recorded later than hands, in whose time contacts are; 0 where that is not told."""
    drift: float
    """Seconds by which that grows in each second; 0 where that is not told."""
    noise: float
    """Metres: what points near hands miss of how these move; 0 where none follow."""


def find_hands(episode: Episode) -> tuple[Hand, ...]:
    """The hands of an episode and their contacts, in order of their first controller."""
    return see_hands(episode).hands


def see_hands(episode: Episode) -> SeenHands:
    """The hands of an episode, and how late its points are.

    A contact is found by what it does: points near the hand come along with it. A hand that rests on the
    object and moves nothing has none. Where it was recorded or said who holds the object, nothing is looked for.
    """
    groups = _group(episode.controllers)
    if episode.contact is not None and not episode.held:
        groups = [part for members in groups for part in _alike(members, episode.contact)]
    followed = following(episode, groups)
    seen = _with_delay(episode, groups, followed, followed.delay)
    if seen.delay and not any(each.kind == ContactKind.HOLD for hand in seen.hands for each in hand.contacts):
        # A press does not tell: an object that follows late has not been told from one that is touched late.
        return _with_delay(episode, groups, followed, 0.0)
    return seen


def _with_delay(episode: Episode, groups: Sequence[np.ndarray], followed: Following, delay: float) -> SeenHands:
    hands = tuple(
        Hand(controllers=members, contacts=_contacts(episode, members, delay, noise))
        for members, noise in zip(groups, followed.noise.tolist(), strict=True)
    )
    drift = followed.drift if delay else 0.0
    return SeenHands(hands=hands, delay=delay, drift=drift, noise=float(followed.noise.max(initial=0.0)))


def _contacts(episode: Episode, members: np.ndarray, delay: float, noise: float) -> tuple[Contact, ...]:
    """Contacts of one hand: what was said, else what was recorded, else what is found."""
    if episode.held:
        return (Contact(first=0, last=episode.frames - 1, kind=ContactKind.HOLD),)
    if episode.contact is not None:
        changes = np.flatnonzero(np.diff(episode.contact[:, members[0]].astype(np.int8), prepend=0, append=0))
        return tuple(
            Contact(first=first, last=end - 1, kind=ContactKind.HOLD) for first, end in changes.reshape(-1, 2).tolist()
        )
    return _find_contacts(look_at_hand(episode, members, delay=delay, noise=noise))


def _alike(members: np.ndarray, contact: np.ndarray) -> list[np.ndarray]:
    """Controllers [H] split into those that hold in the same frames of [T, C] flags."""
    _, kind = np.unique(contact[:, members], axis=1, return_inverse=True)
    return [members[kind.reshape(-1) == each] for each in range(kind.max() + 1)]


def contact_flags(episode: Episode, hands: Sequence[Hand]) -> np.ndarray:
    """[T, C] uint8 `ContactKind`: what each controller point does to the object in each frame."""
    flags = np.zeros(episode.controllers.shape[:2], np.uint8)
    for hand in hands:
        for contact in hand.contacts:
            flags[contact.first : contact.last + 1, hand.controllers] = contact.kind
    return flags


def _group(controllers: np.ndarray) -> list[np.ndarray]:
    """Split [T, C, 3] controllers into hands: points of one hand stay near each other all the time."""
    count = controllers.shape[1]
    widest = np.zeros((count, count))
    for points in controllers[:: max(1, len(controllers) // 50)]:
        widest = np.maximum(widest, np.linalg.norm(points[:, None] - points[None], axis=2))
    label = np.full(count, -1)
    for seed in range(count):
        if label[seed] < 0:
            label[(label < 0) & (widest[seed] < HAND_GAP)] = label.max() + 1
    return [np.flatnonzero(label == hand) for hand in range(label.max(initial=-1) + 1)]


def _find_contacts(scene: HandScene) -> tuple[Contact, ...]:
    """Contacts of the hand of a scene, in order."""
    contacts: list[Contact] = []
    start = 0
    while (onset := _next_onset(scene, start)) is not None:
        held = scene.near_around(onset.first)
        let_go, pulled = _follow(scene, onset.first, held)
        # Whatever a hand can push it can also hold; what it draws it cannot push.
        if pulled > PULLED * scene.step_m:
            kind, last = ContactKind.HOLD, let_go
        elif onset.pushed > 0.5 * MOVED * scene.step_m:
            kind, last = ContactKind.PRESS, _separation(scene, onset)
        else:
            # The object moves by itself, as one that rocks does, and a hand happens to move the same way.
            start = onset.sure + 1
            continue
        first = _touch(scene, onset, start)
        if kind == ContactKind.HOLD:
            # Who takes hold has arrived; a soft object may lag behind a hand that holds it, so this may be before.
            still = (frame for frame in range(first, onset.first) if _slip(scene, frame, held) <= scene.still)
            first = next(still, onset.first)
        first = _still_there(scene, held, first, start)
        contacts.append(Contact(first=first, last=last, kind=kind))
        # A frame between two contacts tells them apart in the flags.
        start = last + 2
    return tuple(contacts)


@dataclass(frozen=True, kw_only=True)
class _Onset:
    """Points near a hand begin to come along with it."""

    first: int
    """Frame from which they do."""
    sure: int
    """Frame in which they have done so for `MOVED` metres."""
    pushed: float
    """Metres of these in which they were ahead of the hand."""


def _next_onset(scene: HandScene, start: int) -> _Onset | None:
    """The first onset from frame `start` on."""
    first, moved, pushed = start, 0.0, 0.0
    for frame in range(start, scene.frames):
        along = scene.along(frame, scene.near_around(frame))
        # With no point to tell, the object is taken to lie still.
        gain = scene.travel[frame] * (along.share if along else -1.0)
        moved += gain
        pushed += gain if along and along.ahead > AHEAD else 0.0
        if moved <= 0:
            first, moved, pushed = frame + 1, 0.0, 0.0
        if moved > MOVED * scene.step_m:
            return _Onset(first=first, sure=frame, pushed=pushed)
    return None


def _follow(scene: HandScene, first: int, held: np.ndarray) -> tuple[int, float]:
    """Last frame in which the points `held` [N] go with the hand, and the metres that it drew them without pushing."""
    together, most, swung, last, pulled = 0.0, 0.0, 0.0, first, 0.0
    drifts = scene.drifts(held, first)
    for frame in range(first, scene.frames):
        along = scene.along(frame, held)
        if along:
            together += scene.travel[frame] * along.share
            pulled += scene.travel[frame] if along.rigidly and along.ahead < AHEAD else 0.0
        speed, against = scene.speeds(frame, held)
        if against is not None:
            # What a hand drops leaves it although it stands still; what slips through it creeps.
            swing = scene.seconds[frame] * max(0.0, against - max(scene.still, speed))
            together, swung = together - swing, swung + swing
        if together >= most:
            most, swung = together, 0.0
        if together + min(swung, SWUNG * scene.step_m) >= most:
            last = frame
        # What swings or is stamped wrongly comes back: hand and points must have parted as far as they lost each other.
        parted = float(np.linalg.norm(drifts[frame] - drifts[last]))
        if min(most - together, parted) > LOST * scene.step_m:
            return _still_there(scene, held, last, scene.frames - 1), pulled
    return scene.frames - 1, pulled


def _touch(scene: HandScene, onset: _Onset, start: int) -> int:
    """First frame, from `start` on, in which points near the hand come along a little; a soft object gives first."""
    frame = onset.first
    while frame > start:
        along = scene.along(frame - 1, scene.near_around(frame - 1))
        if along is None or along.share < 2 * TOUCHED - 1:
            break
        frame -= 1
    return frame


def _separation(scene: HandScene, onset: _Onset) -> int:
    """Last frame in which a pressing hand touches the surface."""
    touching = float(np.median(scene.gap[onset.first : onset.sure + 1]))
    apart = scene.gap > touching + SEPARATED
    for frame in range(onset.sure + 1, scene.frames):
        soon = int(np.searchsorted(scene.times, scene.times[frame] + scene.patience))
        if apart[frame : soon + 1].all():
            return frame - 1
    return scene.frames - 1


def _slip(scene: HandScene, frame: int, held: np.ndarray) -> float:
    """m/s: speed of a hand against the points `held` [N]; those not seen are taken to lie still."""
    speed, against = scene.speeds(frame, held)
    return speed if against is None else against


def _still_there(scene: HandScene, held: np.ndarray, frame: int, end: int) -> int:
    """The frame farthest towards `end` until which a hand stays where it is among the points `held` [N] in `frame`.

    Where these are not seen they are taken to lie where they were last, which tells when a hand came to them
    behind which they disappeared.
    """
    farthest = frame
    direction = 1 if end > frame else -1
    drifts = scene.drifts(held, frame)
    settled = max(SETTLED, SETTLED_NOISES * scene.noise)
    stays = np.linalg.norm(drifts - drifts[frame], axis=1) <= settled
    for other in range(frame + direction, end + direction, direction):
        if stays[other] and _slip(scene, other, held) <= scene.still:
            farthest = other
        elif scene.speeds(other, held)[1] is None:
            continue
        elif abs(scene.times[other] - scene.times[farthest]) > scene.patience:
            return farthest
    # What nothing contradicts up to the first or last frames is so in them.
    return end if abs(scene.times[end] - scene.times[farthest]) <= scene.patience else farthest
