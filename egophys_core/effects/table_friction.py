"""Friction of the table that differs from node to node.

Coulomb friction takes mu times the normal force, so a node that shall feel mu (1 + c) is pressed down by c times the
weight it bears: it sticks and slips as with that coefficient, and the table takes up the rest. Within `CONTACT_BAND` of
the table it is also that much heavier, which holds it back by a few millimetres when it is lifted.
"""

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays

CONTACT_BAND = 0.006
"""Metres above the height of contact at which a node no longer counts as lying on the table."""

LARGEST_BEARING = 4.0
"""A node bears at most this many times its own weight: of a solid that is held, the table bears less than all."""


def bearing(body: Body) -> float:
    """Weight on a node that touches the table over its own: 1 for a sheet that lies flat, more for a solid."""
    heights = body.rest_positions[:, 2]
    return min(1.0 / float(np.mean(heights < heights.min() + CONTACT_BAND)), LARGEST_BEARING)


@wp.func
def on_table(height: Lanes) -> Lanes:
    """0..1: how much a node, metres above contact, lies on the table; it fades out over `CONTACT_BAND`."""
    share = Lanes()
    for lane in range(LANES):
        share[lane] = wp.min(wp.max(1.0 - height[lane] / CONTACT_BAND, 0.0), 1.0)
    return share


@wp.func
def press(
    group: int,
    node: int,
    change: Lanes,
    state: StateArrays,
    parameters: ParameterArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Add the force, N, that changes the friction of a node by `change` times the table's, its bearing included."""
    lies = on_table(state.positions[group, node, 2] - parameters.contact_height[group])
    weight = wp.cw_mul(parameters.masses[group, node], parameters.gravity[group])
    forces[group, node, 2] -= wp.cw_mul(weight, wp.cw_mul(change, lies))
