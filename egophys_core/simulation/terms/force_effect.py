"""The hook for forces that the base simulator lacks: they are composed into its kernels."""

from dataclasses import dataclass, replace

import numpy as np
import warp as wp


@dataclass(frozen=True, kw_only=True)
class ForceEffect:
    """An extra force and its numbers in each rollout of a batch.

    `add_forces` is a `wp.func` that adds newtons to the forces on a range of nodes, as the terms of `step` do::

        add_forces(group, first, last, column, time, state, parameters, numbers, forces)

    with `column` the place of the effect's first number in `numbers` [G, P] and `time` seconds since the start of
    the rollout (`Lanes`); its other arguments are those of `body_forces.add_body_forces`. It must not read
    what it writes, so that it can be differentiated.
    """

    add_forces: wp.Function
    numbers: np.ndarray
    """[K, P_e] float32, the effect's parameters in SI units, in the order it reads them."""
    settle: wp.Kernel | None = None
    """Launched at the start of each frame, for each lane group, with `column`, the number of nodes, `state` and
    `numbers`, of which it writes the effect's own: what settles before nodes have moved."""
    rates: np.ndarray | None = None
    """[K, 2] largest omega^2, 1/s^2, and damping rate, 1/s, of what it adds, if that asks for shorter substeps."""

    def rows(self, rows: np.ndarray) -> "ForceEffect":
        """The effect in some rollouts, in this order."""
        rates = None if self.rates is None else self.rates[rows]
        return replace(self, numbers=self.numbers[rows], rates=rates)
