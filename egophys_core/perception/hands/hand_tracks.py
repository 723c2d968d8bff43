"""Hands from view to view: which arm is which, and the outline of its hand."""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from egophys_core.perception.hands.arms import SeenArm, SizeCue, arm_at, find_arms, is_near
from egophys_core.perception.hands.hand_outline import HandOutline
from egophys_core.perception.hands.outline_follower import OutlineFollower
from egophys_core.perception.masks.silhouette import inside

MOST_HANDS = 2
"""Of one person."""

FARTHEST_STEP = 0.2
"""Of the side of the view: no hand moves farther from one view to the next."""

RADII = 9
"""Views over which the median of the half width of a mask is taken."""


class HandTracks:
    """Up to `MOST_HANDS` arms whose hands have been at the object; other things that move are none of them."""

    def __init__(self) -> None:
        """No hand has been at the object."""
        self._centres: dict[int, np.ndarray] = {}
        self._outlines: dict[int, OutlineFollower] = {}
        self._radii: dict[int, list[float]] = {}

    def next(self, image: np.ndarray, hand: np.ndarray, surface: np.ndarray) -> dict[int, SeenArm]:
        """Arms of the hands in the next view, by the hand's number.

        Args:
            image: [S, S, 3] uint8, BGR.
            hand: [S, S] bool, all that may be arms.
            surface: [S, S] bool, where the object is, seen or hidden.
        """
        arms = find_arms(hand, surface)
        followed = self._followed(image, hand)
        found: dict[int, SeenArm] = {}
        taken: set[int] = set()
        for number, outline in followed.items():
            index = _arm_of(outline, arms, taken)
            taken |= set() if index is None else {index}
            found[number] = arm_at(outline, surface) if index is None else arms[index].with_outline(outline)
        for apart, number, index in sorted(
            (float(np.linalg.norm(arm.centre - centre)), number, index)
            for number, centre in self._centres.items()
            for index, arm in enumerate(arms)
        ):
            if apart < FARTHEST_STEP * len(hand) and number not in found and index not in taken:
                found[number] = self._outlined(number, image, hand, arms[index], followed)
                taken.add(index)
        for index, arm in enumerate(arms):
            if index not in taken and len(self._centres) < MOST_HANDS and is_near(arm, surface):
                number = len(self._centres)
                self._outlines[number] = OutlineFollower()
                found[number] = self._outlined(number, image, hand, arm, followed)
                self._centres[number] = found[number].centre
        for number, arm in found.items():
            self._centres[number] = arm.centre
        return {number: self._steadied(number, arm) for number, arm in found.items()}

    def _steadied(self, number: int, arm: SeenArm) -> SeenArm:
        """The arm; widths of masks come and go by a pixel, so theirs is the median of the last ones."""
        if arm.cue != SizeCue.MASK:
            return arm
        self._radii[number] = [*self._radii.get(number, [])[1 - RADII :], arm.radius]
        return replace(arm, radius=float(np.median(self._radii[number])))

    def _followed(self, image: np.ndarray, hand: np.ndarray) -> dict[int, HandOutline]:
        """Outlines that are followed from the view before, no two of one hand."""
        followed: dict[int, HandOutline] = {}
        for number, follower in self._outlines.items():
            outline = follower.follow(image, hand)
            if outline is not None and not _meets(outline, followed.values()):
                followed[number] = outline
        return followed

    def _outlined(
        self, number: int, image: np.ndarray, hand: np.ndarray, arm: SeenArm, others: Mapping[int, HandOutline]
    ) -> SeenArm:
        """An arm with the outline of its hand, if it has one and that is of no other hand."""
        outline = self._outlines[number].find(image, hand, arm)
        return arm if outline is None or _meets(outline, others.values()) else arm.with_outline(outline)


def _arm_of(outline: HandOutline, arms: Sequence[SeenArm], taken: Container[int]) -> int | None:
    """Index of the arm that ends nearest to an outline, of those that reach into it."""
    x, y = inside(outline.centre[None], arms[0].mask.shape)[0] if arms else (0, 0)
    reaching = [index for index, arm in enumerate(arms) if index not in taken and arm.mask[y, x]]
    return min(reaching, key=lambda index: float(np.linalg.norm(arms[index].centre - outline.centre)), default=None)


def _meets(outline: HandOutline, others: Iterable[HandOutline]) -> bool:
    """Whether an outline lies over one of others by half of its width."""
    return any(np.linalg.norm(outline.centre - other.centre) < other.size for other in others)
