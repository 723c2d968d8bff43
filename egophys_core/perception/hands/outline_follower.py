"""The outline of one hand from view to view."""

from dataclasses import replace

import numpy as np

from egophys_core.perception.hands.arms import SeenArm
from egophys_core.perception.hands.hand_likeness import HandLikeness, as_smooth
from egophys_core.perception.hands.hand_outline import HandOutline, find_outline, follow_outline, likelihood

AROUND = 4.0
"""Half of the side of the part of the view that is looked at, in half widths of the hand."""

SMALLEST_PX = 24
"""Of the side of that part; less of it is in view where a hand has left."""

PATIENCE = 3
"""Views between attempts to find an outline that is lost."""

SURE_SUPPORT = 0.6
"""Support below which a better outline is looked for than the one that was followed."""

LEAST_LIKELIHOOD = 0.5
"""Of an outline that is followed: one of half the size is that of something else."""

SMALLER = 0.85
"""Share of the last size from which on it is looked for."""

STEADINESS = 0.5
"""Share of the last motion that is taken over into the motion that is expected."""


class OutlineFollower:
    """Finds the outline of a hand at the end of its arm and follows it by itself, since masks may be wrong there."""

    def __init__(self) -> None:
        """Nothing is known."""
        self._likeness = HandLikeness()
        self._last: HandOutline | None = None
        self._move = np.zeros(2)
        self._lost = self._doubtful = 0

    def follow(self, image: np.ndarray, arms: np.ndarray) -> HandOutline | None:
        """The outline in the next view, from where it was before; None if it was or is lost.

        Args:
            image: [S, S, 3] uint8, BGR.
            arms: [S, S] bool: all that is taken for hands and arms.
        """
        before = self._last
        if before is None:
            return None
        part = _Part(image, before.centre, before.half_widths[1])
        if part.is_out_of_view:
            return self._keep(image, arms, part, None)
        moves = [self._move, np.zeros(2), 0.5 * self._move]
        likeness = self._likeness.of(part.of(image))
        found = follow_outline(part.of(image), likeness, part.inside(before), moves)
        self._doubtful = 0 if found and found.support >= SURE_SUPPORT else self._doubtful + 1
        if found is None or self._doubtful % PATIENCE == 1:
            expected = part.inside(before).centre + self._move
            others = (found, find_outline(part.of(image), likeness, expected, SMALLER * before.size))
            found = max((each for each in others if each), key=lambda each: likelihood(each, before), default=None)
            found = None if found is None or likelihood(found, before) < LEAST_LIKELIHOOD else found
        return self._keep(image, arms, part, found)

    def find(self, image: np.ndarray, arms: np.ndarray, arm: SeenArm) -> HandOutline | None:
        """The outline of the hand at the end of an arm, for one that is not followed; looked for now and then.

        Args:
            image: [S, S, 3] uint8, BGR.
            arms: [S, S] bool: all that is taken for hands and arms.
            arm: of the hand.
        """
        self._lost += 1
        if (self._lost - 1) % PATIENCE:
            return None
        part = _Part(image, arm.centre, arm.radius)
        seen, mask, place = part.of(image), part.of(arm.mask), arm.centre - part.corner
        known = self._likeness.known
        likely = [self._likeness.of(seen)] if known else [mask.astype(np.float32), as_smooth(seen, mask)]
        tries = (find_outline(seen, likeness, place, arm.radius) for likeness in likely)
        found = max((each for each in tries if each), key=lambda each: each.support, default=None)
        return self._keep(image, arms, part, found)

    def _keep(
        self, image: np.ndarray, arms: np.ndarray, part: "_Part", found: HandOutline | None
    ) -> HandOutline | None:
        if found is None:
            self._last, self._move = None, np.zeros(2)
            return None
        if found.support >= SURE_SUPPORT:
            self._likeness.learn(part.of(image), found, part.of(arms))
        outline = replace(found, centre=found.centre + part.corner)
        if self._last is not None:
            step = outline.centre - self._last.centre
            self._move = (1 - STEADINESS) * self._move + STEADINESS * step
        self._last, self._lost = outline, 0
        return outline


class _Part:
    """The part of a view around a hand."""

    def __init__(self, image: np.ndarray, centre: np.ndarray, half_width: float) -> None:
        side, half = len(image), int(AROUND * half_width)
        low, high = (np.clip(np.rint(centre).astype(int) + sign * half, 0, side) for sign in (-1, 1))
        self.corner, self._high = low, high
        self._rows, self._columns = slice(low[1], high[1]), slice(low[0], high[0])

    @property
    def is_out_of_view(self) -> bool:
        """Whether next to nothing of it is in the view."""
        return bool((self._high - self.corner < SMALLEST_PX).any())

    def of(self, image: np.ndarray) -> np.ndarray:
        """The part of an image [S, S, ...] of the view."""
        return image[self._rows, self._columns]

    def inside(self, outline: HandOutline) -> HandOutline:
        """An outline in pixels of this part."""
        return replace(outline, centre=outline.centre - self.corner)
