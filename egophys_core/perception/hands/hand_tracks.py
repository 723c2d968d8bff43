"""Hands from view to view: which arm is which, and how deep in the view a hand is by its width."""

import numpy as np

from egophys_core.perception.hands.arms import SeenArm, find_arms, is_near

MOST_HANDS = 2
"""Of one person."""

FARTHEST_STEP = 0.2
"""Of the side of the view: no hand moves farther from one view to the next."""

USUAL_HALF_WIDTH_M = 0.042
"""Metres: of a closed hand of which nothing else is known."""

RADII = 9
"""Views over which the median of the half width in pixels is taken."""


class HandTracks:
    """Up to `MOST_HANDS` arms whose hands have been at the object; other things that move are none of them."""

    def __init__(self) -> None:
        """No hand has been at the object."""
        self._centres: dict[int, np.ndarray] = {}

    def next(self, hand: np.ndarray, surface: np.ndarray) -> dict[int, SeenArm]:
        """Arms of the hands in the next view, by the hand's number.

        Args:
            hand: [S, S] bool, all that may be arms.
            surface: [S, S] bool, where the object is, seen or hidden.
        """
        arms = find_arms(hand, surface)
        found: dict[int, SeenArm] = {}
        pairs = sorted(
            (float(np.linalg.norm(arm.centre - centre)), number, index)
            for number, centre in self._centres.items()
            for index, arm in enumerate(arms)
        )
        taken: set[int] = set()
        for apart, number, index in pairs:
            if apart < FARTHEST_STEP * len(hand) and number not in found and index not in taken:
                found[number] = arms[index]
                taken.add(index)
        for index, arm in enumerate(arms):
            if index not in taken and len(self._centres) < MOST_HANDS and is_near(arm, surface):
                found[len(self._centres)] = arm
                self._centres[len(self._centres)] = arm.centre
        for number, arm in found.items():
            self._centres[number] = arm.centre
        return found


class HandWidth:
    """Half the width of a hand in metres; with that in pixels it tells the hand's depth."""

    def __init__(self) -> None:
        """Nothing is known but how wide hands usually are."""
        self._metres = USUAL_HALF_WIDTH_M
        self._radii: list[float] = []

    def see(self, arm: SeenArm) -> None:
        """Take the width in the next view."""
        self._radii = [*self._radii[1 - RADII :], arm.radius]

    def learn(self, depth: float, focal: float) -> None:
        """The hand is at a depth, metres, of which something else tells."""
        self._metres = float(np.median(self._radii)) * depth / focal

    def depth(self, focal: float) -> float:
        """Metres along the optical axis, by the width; NaN before the hand is seen."""
        return focal * self._metres / float(np.median(self._radii)) if self._radii else np.nan
