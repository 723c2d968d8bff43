"""What perception saw in each second of a video: how much of the object, how surely, and how many hands."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from egophys_core.perception.observation import Observation

_LOST = 0.1
"""Confidence below which a point counts as lost rather than doubtful."""


@dataclass(frozen=True, kw_only=True)
class Second:
    """One second of a video."""

    start_s: float
    """Seconds from the first frame of the video."""
    coverage: float
    """0..1: share of the points, over all frames of the second, that are in the episode; of frames that were not
    observed, for want of a camera pose, none is."""
    doubtful: float
    """0..1: share of the points, over all frames, that are followed with too little confidence for the episode."""
    confidence: float
    """0..1: median over the points, then over the observed frames; NaN without any."""
    hands: int
    """Hands seen at once, at most."""
    touching: int
    """Hands that touch the object at once, at most."""


@dataclass(frozen=True, kw_only=True)
class _Look:
    """One observed frame."""

    stamp_ns: int
    coverage: float
    doubtful: float
    confidence: float
    hands: int
    touching: int


@dataclass(kw_only=True)
class SecondsSeen:
    """Keeps a few numbers of each observation."""

    least_confidence: float
    """Of points that are in the episode."""
    _looks: list[_Look] = field(default_factory=list)

    def add(self, observation: Observation) -> None:
        """Take the next observation."""
        confidence, hands = observation.confidence, observation.hands.values()
        sure, followed = confidence >= self.least_confidence, confidence >= _LOST
        # Learned stages give a mask and points of a hand, not hands by number.
        holds = sum(hand.has_contact for hand in hands) if hands else np.isfinite(observation.hand_points).any()
        self._looks.append(
            _Look(
                stamp_ns=observation.view.stamp_ns,
                coverage=float(sure.mean()),
                doubtful=float((followed & ~sure).mean()),
                confidence=float(np.median(confidence)),
                hands=max(len(hands), int(observation.masks.hand.any())),
                touching=int(holds),
            )
        )

    @property
    def hand_seen(self) -> int:
        """Observations in which a hand is seen."""
        return sum(look.hands > 0 for look in self._looks)

    def seconds(self, stamps_ns: Sequence[int]) -> tuple[Second, ...]:
        """Each second of a video with frames at these stamps; what is left over at its end belongs to the last one."""
        count = max(int((stamps_ns[-1] - stamps_ns[0]) * 1e-9 + 0.5), 1)
        of_frames = _second_of(stamps_ns, stamps_ns[0], count)
        of_looks = _second_of([look.stamp_ns for look in self._looks], stamps_ns[0], count)
        found = []
        for index in range(count):
            looks = [self._looks[each] for each in np.flatnonzero(of_looks == index)]
            frames = max(np.count_nonzero(of_frames == index), 1)
            found.append(
                Second(
                    start_s=float(index),
                    coverage=sum(look.coverage for look in looks) / frames,
                    doubtful=sum(look.doubtful for look in looks) / frames,
                    confidence=float(np.median([look.confidence for look in looks])) if looks else float("nan"),
                    hands=max((look.hands for look in looks), default=0),
                    touching=max((look.touching for look in looks), default=0),
                )
            )
        return tuple(found)


def _second_of(stamps_ns: Sequence[int], start_ns: int, count: int) -> np.ndarray:
    """[T] int: which second each stamp is in, at most the last of so many."""
    return np.minimum((np.asarray(stamps_ns, np.int64) - start_ns) // 1_000_000_000, count - 1)
