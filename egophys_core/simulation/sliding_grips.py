"""Grips that slip: how far what is held has slid through each hand, frame by frame, by how it pulls there."""

from collections.abc import Sequence

import numpy as np

from egophys_core.effects.hands import hands_of
from egophys_core.simulation.attachments import Attachments
from egophys_core.simulation.batch import RolloutBatch
from egophys_core.simulation.controls import ContactKind
from egophys_core.simulation.terms.springs import SHORTEST_LENGTH


class SlidingGrips:
    """Of the rollouts of a batch; those without a law of sliding stay 0."""

    def __init__(self, batch: RolloutBatch) -> None:
        """Nothing has slid yet."""
        self._batch = batch
        self._slides = batch.slides or ((),) * batch.count
        self._times = batch.controls[0].times
        frames, controllers = batch.controls[0].contact.shape
        self.before = np.zeros((batch.count, frames, controllers, 3))
        """[K, F, C, 3] metres that what is held has slid as each frame begins."""
        self.within = np.zeros((batch.count, frames - 1, controllers, 3))
        """[K, F - 1, C, 3] metres that it slides in each frame."""
        self.pulls = np.zeros_like(self.within)
        """[K, F - 1, C, 3] what pulls on the hand of each controller point as a frame begins, over the weight."""
        holds = np.stack([each.contact == ContactKind.HOLD for each in batch.controls])
        self.goes_on = holds[:, :-1] & holds[:, 1:]
        """[K, F - 1, C] whether a hold of each frame is still there in the next one."""
        self._hands = [hands_of(each.positions) for each in batch.controls]

    def slide(self, frame: int, nodes: np.ndarray, attachments: Sequence[Attachments]) -> None:
        """From the nodes [K, N, 3], metres, and what is held as a frame begins; the slip of a hold ends with it."""
        ends = self._times[frame : frame + 2]
        for row, laws in enumerate(self._slides):
            if laws:
                self.pulls[row, frame] = pulls = self._pulls(row, frame, nodes[row], attachments[row])
                slid = sum(law(ends[:1], ends[1:], pulls[None])[0] for law in laws)
                self.within[row, frame] = slid
                self.before[row, frame + 1] = np.where(
                    self.goes_on[row, frame, :, None], self.before[row, frame] + slid, 0.0
                )

    def _pulls(self, row: int, frame: int, nodes: np.ndarray, held: Attachments) -> np.ndarray:
        """[C, 3] by the springs of all points of a hand, over the object's weight; 0 where nothing is held."""
        controls, parameters = self._batch.controls[row], self._batch.parameters[row]
        points = held.controllers[held.holds]
        centres = controls.positions[frame] + self.before[row, frame]
        away = nodes[held.nodes[held.holds]] - centres[points]
        lengths = np.maximum(np.linalg.norm(away, axis=1), SHORTEST_LENGTH)
        tensions = parameters.controller_stiffness * (lengths - held.rest_lengths[held.holds])
        hands = self._hands[row]
        of_hands = np.zeros((len(hands), 3))
        np.add.at(of_hands, hands[points], (tensions / lengths)[:, None] * away)
        weight = float(self._batch.masses[row].sum()) * parameters.gravity
        found = np.zeros_like(centres, dtype=np.float64)
        found[points] = of_hands[hands[points]] / max(weight, np.finfo(float).tiny)
        return found

    def gradient(self, by_before: np.ndarray, by_within: np.ndarray) -> np.ndarray:
        """[K, F - 1, C, 3] derivatives by `within`, as what slides in a frame stays for the rest of a hold.

        Args:
            by_before: [K, F - 1, C, 3] by what had slid as each frame began, for that frame alone.
            by_within: [K, F - 1, C, 3] by what slides in it, for that frame alone.
        """
        found = by_within.copy()
        later = np.zeros_like(by_before[:, 0])
        for frame in reversed(range(by_before.shape[1])):
            passed = np.where(self.goes_on[:, frame, :, None], later, 0.0)
            found[:, frame] += passed
            later = by_before[:, frame] + passed
        return found

    def rows(self, rows: np.ndarray) -> "SlidingGrips":
        """Those of some rollouts, in this order, as often as they are named."""
        found = SlidingGrips(self._batch.rows(rows))
        found.before, found.within, found.pulls = self.before[rows], self.within[rows], self.pulls[rows]
        return found
