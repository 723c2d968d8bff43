"""What a hand holds: stiff, damped ties from vertices to places that move with the hand."""

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.geometry import about_vertical
from egophys_core.rehearsal.engine import HAND_RADIUS
from egophys_core.rehearsal.hands import Hands

FREQUENCY = 400.0
"""rad/s of a held vertex on its tie; far above the motion of the body and within what the step can follow."""

GRIP_RADIUS = HAND_RADIUS
"""Metres from a hand's centre within which a vertex is held."""

FEWEST_HELD = 4
"""Vertices that a hand holds even when they are a little farther away."""

FAINT_PULL = 0.05
"""Share of the body's weight; a weaker pull slides nothing out of the hand."""


class Grip:
    """The vertices in the hands, from when the grip closes."""

    def __init__(self, positions: np.ndarray, hands: Hands) -> None:
        """Hold the vertices at `positions` [V, 3] that are in reach of the hands; one too far away holds none."""
        distances = np.linalg.norm(positions[:, None] - hands.centres, axis=2)
        order = np.sort(distances, axis=0)[FEWEST_HELD - 1]
        radius = np.where(order < 2.0 * GRIP_RADIUS, np.maximum(order, GRIP_RADIUS), 0.0)
        held = (distances <= radius) & (distances == distances.min(axis=1, keepdims=True))
        self.vertices, self._hand = np.nonzero(held)
        """[A] what is held, and by which hand."""
        self._offsets = positions[self.vertices] - hands.centres[self._hand]
        self._first_turns = hands.turns
        self._last_hands = hands
        self._count = len(hands.centres)

    def add_forces(
        self,
        forces: np.ndarray,
        *,
        positions: np.ndarray,
        velocities: np.ndarray,
        masses: np.ndarray,
        hands: Hands,
        duration: float,
        slip: np.ndarray | None,
    ) -> None:
        """Add the forces of the ties, N, to `forces` [V, 3].

        Args:
            forces: what to add to.
            positions: [V, 3] metres.
            velocities: [V, 3] m/s.
            masses: [V] kg.
            hands: now.
            duration: seconds since the last call.
            slip: [3] m/s at which what is held slides through each hand: as it is where that pulls straight down, else
                -z of it along the pull.
        """
        turned, before = self._turned(hands), self._turned(self._last_hands)
        hand_velocities = (hands.centres - self._last_hands.centres) / duration
        self._last_hands = hands
        stretch = hands.centres[self._hand] + turned - positions[self.vertices]
        speed = hand_velocities[self._hand] + (turned - before) / duration - velocities[self.vertices]
        ties = masses[self.vertices, None] * (FREQUENCY**2 * stretch + 2.0 * FREQUENCY * speed)
        np.add.at(forces, self.vertices, ties)
        if slip is not None:
            pulls = np.zeros((self._count, 3))
            np.add.at(pulls, self._hand, -masses[self.vertices, None] * FREQUENCY**2 * stretch)
            sizes = np.linalg.norm(pulls, axis=1, keepdims=True)
            strong = sizes > FAINT_PULL * GRAVITY * masses.sum()
            slides = -slip[2] * pulls / np.maximum(sizes, 1e-9) + (slip[0], slip[1], 0.0)
            slid = duration * np.where(strong, slides, 0.0)[self._hand]
            self._offsets += about_vertical(slid, -self._turns(hands))

    def _turns(self, hands: Hands) -> np.ndarray:
        """[A] radians by which the hands that hold have turned since they took hold."""
        return (hands.turns - self._first_turns)[self._hand]

    def _turned(self, hands: Hands) -> np.ndarray:
        """[A, 3] metres from the hands to where the ties hold."""
        turns = self._turns(hands)
        # Most hands never turn, and there are thousands of steps in a second.
        return about_vertical(self._offsets, turns) if turns.any() else self._offsets
