"""Friction of the table that differs from node to node.

Coulomb friction takes mu times the normal force, so a node that shall feel mu (1 + c) is pressed down by c times the
weight it bears: it sticks and slips as with that coefficient, and the table takes up the rest. Within `CONTACT_BAND` of
the table it is also that much heavier, which holds it back by a few millimetres when it is lifted.
"""

import numpy as np

from egophys_core.effects.effect import CONTACT_BAND, Scene

LARGEST_BEARING = 4.0
"""A node bears at most this many times its own weight: of a solid that is held, the table bears less than all."""


def bearing(scene: Scene) -> float:
    """Weight on a node that touches the table over its own: 1 for a sheet that lies flat, more for a solid."""
    heights = scene.rest_positions[:, 2]
    return min(1.0 / float(np.mean(heights < heights.min() + CONTACT_BAND)), LARGEST_BEARING)


def pressed(scene: Scene, change: np.ndarray, borne: float) -> np.ndarray:
    """[N, 3] m/s^2 that change the friction of each node by `change` [N] times the table's, given its `bearing`."""
    acceleration = np.zeros_like(scene.positions)
    acceleration[:, 2] = -scene.gravity * borne * change * scene.on_table
    return acceleration
