"""What effects ask of the substeps: by how much they may stiffen springs, and the rates of what else they add."""

from dataclasses import dataclass

import numpy as np

from egophys_core.simulation.batch import RolloutBatch

STRAIN_MARGIN, STRAIN_REACH = 1.2, 0.01
"""In a frame the largest strain is taken to grow to this times itself, and by this."""

SPEED_MARGIN, SPEED_REACH = 1.2, 0.5
"""Likewise the largest speed; m/s, what gravity and hands add in a frame."""


@dataclass(frozen=True, kw_only=True)
class Added:
    """What effects add in each of K rollouts."""

    factor: np.ndarray
    """[K] on the stiffness of springs, at least 1."""
    stiffness: np.ndarray
    """[K] largest omega^2, 1/s^2, besides that of springs."""
    damping: np.ndarray
    """[K] largest damping rate, 1/s, besides that of springs."""


class EffectRates:
    """Bounds for a batch; those that depend on strain or speed are asked for anew in each frame."""

    def __init__(self, batch: RolloutBatch) -> None:
        self.batch = batch
        self.stiffness, self.damping = np.zeros(batch.count), np.zeros(batch.count)
        if batch.rods is not None:
            self.stiffness, self.damping = batch.rods.rates.T.astype(np.float64)
        for each in batch.effects:
            force = each.effect.node_force
            if force and force.stiffness_rate:
                self.stiffness = self.stiffness + force.stiffness_rate(each.numbers.astype(np.float64))
        self.laws = [each for each in batch.effects if each.effect.spring_law]
        self.drags = [each for each in batch.effects if each.effect.node_force and each.effect.node_force.damping_rate]
        self.follows = bool(self.drags) or any(
            each.effect.spring_law.follows_strain for each in self.laws if each.effect.spring_law
        )
        """Whether bounds depend on the present strain or speed."""

    def at_rest(self) -> Added:
        """Bounds of an object that is not strained and does not move."""
        zeros = np.zeros(self.batch.count)
        return self._bounds(zeros, zeros)

    def at(self, strains: np.ndarray, speeds: np.ndarray) -> Added:
        """Bounds for a frame at whose start the largest strain [K] and speed [K], m/s, are these."""
        return self._bounds(STRAIN_MARGIN * strains + STRAIN_REACH, SPEED_MARGIN * speeds + SPEED_REACH)

    def _bounds(self, strains: np.ndarray, speeds: np.ndarray) -> Added:
        factor, damping = np.ones(self.batch.count), self.damping
        for each in self.laws:
            law = each.effect.spring_law
            if law:
                stiffer = np.maximum(law.stiffening(each.numbers.astype(np.float64), strains), 1.0)
                factor = factor * np.where(each.present, stiffer, 1.0)
        for each in self.drags:
            force = each.effect.node_force
            if force and force.damping_rate:
                damping = damping + force.damping_rate(each.numbers.astype(np.float64), speeds)
        return Added(factor=factor, stiffness=self.stiffness, damping=damping)
