"""When each hand holds the object or only presses against it, found from what the points near it do.

What was measured and how the thresholds were chosen: docs/notes/contact.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.hand_scene import HandScene, look_at_hand, observed_delay
from egophys_core.simulation import ContactKind

HAND_GAP = 0.15
"""Metres: controller points that never come this near to each other belong to different hands."""

MOVED = 0.005
"""Metres that points come along with a hand before it has contact; less is noise."""

LOST = 0.02
"""Metres that a hand moves without the points it held, or they without it, before it has let go."""

PULLED = 0.03
"""Metres: a hand that draws points this far that are not ahead of it holds them. A squeezed toy springs back less."""

AHEAD = 0.2
"""Mean cosine between the hand's displacement and the directions to points: above it they are ahead, may be pushed."""

STILL = 0.04
"""m/s: a hand that moves no faster than this against the points near it has arrived, or slips without letting go."""

SETTLED = 0.006
"""Metres: a hand no farther than this from where it held has arrived, or not yet left. Soft objects give that much."""

PATIENCE_S = 0.1
"""Noise and hidden points may make a hand that stays look as if it moved away, but not for longer than this."""

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


def find_hands(episode: Episode) -> list[Hand]:
    """The hands of an episode and their contacts, in order of their first controller.

    A contact is found by what it does: points near the hand come along with it. A hand that rests on the
    object and moves nothing has none.
    """
    groups = _group(episode.controllers)
    scenes = [look_at_hand(episode, members) for members in groups]
    hands = _in_scenes(groups, scenes)
    holds = contact_flags(episode, hands) == ContactKind.HOLD
    delay = observed_delay(scenes, [holds[:, members[0]] for members in groups])
    return _in_scenes(groups, [look_at_hand(episode, members, delay=delay) for members in groups]) if delay else hands


def _in_scenes(groups: Sequence[np.ndarray], scenes: Sequence[HandScene]) -> list[Hand]:
    pairs = zip(groups, scenes, strict=True)
    return [Hand(controllers=members, contacts=_find_contacts(scene)) for members, scene in pairs]


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
        if pulled > PULLED:
            kind, last = ContactKind.HOLD, let_go
        elif onset.pushed > 0.5 * MOVED:
            kind, last = ContactKind.PRESS, _separation(scene, onset)
        else:
            # The object moves by itself, as one that rocks does, and a hand happens to move the same way.
            start = onset.sure + 1
            continue
        first = _touch(scene, onset, start)
        if kind == ContactKind.HOLD:
            # Who takes hold has arrived; a soft object may lag behind a hand that holds it, so this may be before.
            still = (frame for frame in range(first, onset.first) if _slip(scene, frame, held) <= STILL)
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
        if moved > MOVED:
            return _Onset(first=first, sure=frame, pushed=pushed)
    return None


def _follow(scene: HandScene, first: int, held: np.ndarray) -> tuple[int, float]:
    """Last frame in which the points `held` [N] go with the hand, and the metres that it drew them without pushing."""
    together, most, last, pulled = 0.0, 0.0, first, 0.0
    for frame in range(first, scene.frames):
        along = scene.along(frame, held)
        if along:
            together += scene.travel[frame] * along.share
            pulled += scene.travel[frame] if along.rigidly and along.ahead < AHEAD else 0.0
        speed, against = scene.speeds(frame, held)
        if against is not None:
            # What a hand drops leaves it although it stands still; what slips through it creeps.
            together -= scene.seconds[frame] * max(0.0, against - max(STILL, speed))
        if together >= most:
            most, last = together, frame
        if together < most - LOST:
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
        soon = int(np.searchsorted(scene.times, scene.times[frame] + PATIENCE_S))
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
    for other in range(frame + direction, end + direction, direction):
        if _slip(scene, other, held) <= STILL and scene.drift(other, frame, held) <= SETTLED:
            farthest = other
        elif scene.speeds(other, held)[1] is not None and abs(scene.times[other] - scene.times[farthest]) > PATIENCE_S:
            break
    return farthest
