"""Stiffness of springs from a codebook: features of how each is deformed, assignments, offsets (paper, Sec. 3.3).

Evaluated as a frame begins and held for two of a video (docs/notes/prior.md has what that costs and saves).
"""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays
from egophys_core.simulation.terms.codebook_network import NetworkArrays, stiffness_factor
from egophys_core.simulation.terms.springs import SHORTEST_LENGTH, SpringArrays
from egophys_core.twin.codebook import MOST_OFFSET


@wp.struct
class CodebookArrays:
    """What stiffness follows from besides the network and the state."""

    low: wp.array(dtype=float)
    """[6] limits of the dynamic features."""
    high: wp.array(dtype=float)
    """[6]."""
    anchors: wp.array2d(dtype=Lanes)
    """[G, E] N/m, the stiffness that offsets are added to, in logarithms; 0 where a rollout lacks the spring."""
    used: wp.array2d(dtype=Lanes)
    """[G, E] 1 for springs of rollouts that have the codebook, else 0."""
    held: wp.array2d(dtype=Lanes)
    """[G, N] 1 for nodes that a hand holds."""


@wp.func
def limited(values: Lanes, low: float, high: float) -> Lanes:
    """Each value within the limits."""
    inside = Lanes()
    for lane in range(LANES):
        inside[lane] = wp.min(wp.max(values[lane], low), high)
    return inside


@wp.kernel(enable_backward=False)
def predict_stiffness(
    rows: int,
    nodes: int,
    state: StateArrays,
    parameters: ParameterArrays,
    network: NetworkArrays,
    codebook: CodebookArrays,
    springs: SpringArrays,
    stiffness: wp.array2d(dtype=Lanes),
    largest: wp.array2d(dtype=Lanes),
):
    """The stiffness of all springs in the present state, N/m, and the largest factor; dim = (G, ceil(N / rows)).

    A spring without length has the direction 0.
    """
    group, thread = wp.tid()
    positions = state.positions
    velocities = state.velocities
    hands = codebook.held
    low = codebook.low
    high = codebook.high
    ground = parameters.contact_height[group]
    most = Lanes()
    for node in range(thread * rows, wp.min((thread + 1) * rows, nodes)):
        for spring in range(springs.starts[node], springs.starts[node + 1]):
            other = springs.ends[spring]
            dx = positions[group, other, 0] - positions[group, node, 0]
            dy = positions[group, other, 1] - positions[group, node, 1]
            dz = positions[group, other, 2] - positions[group, node, 2]
            wx = velocities[group, other, 0] - velocities[group, node, 0]
            wy = velocities[group, other, 1] - velocities[group, node, 1]
            wz = velocities[group, other, 2] - velocities[group, node, 2]
            squared = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
            along = wp.cw_mul(dx, wx) + wp.cw_mul(dy, wy) + wp.cw_mul(dz, wz)
            height = 0.5 * (positions[group, node, 2] + positions[group, other, 2]) - ground
            rest = springs.rest_lengths[group, spring]
            stretch = Lanes()
            size = Lanes()
            rate = Lanes()
            vertical = Lanes()
            held = Lanes()
            stretched = Lanes()
            for lane in range(LANES):
                length = wp.max(wp.sqrt(squared[lane]), SHORTEST_LENGTH)
                ratio = length / rest[lane]
                stretch[lane] = wp.log(ratio)
                size[lane] = wp.abs(ratio - 1.0)
                rate[lane] = along[lane] / (length * rest[lane])
                vertical[lane] = wp.abs(dz[lane]) / length
                held[lane] = wp.max(hands[group, node][lane], hands[group, other][lane])
                stretched[lane] = wp.where(ratio >= 1.0, 1.0, 0.0)
            factor = stiffness_factor(
                network,
                group,
                spring,
                limited(stretch, low[0], high[0]),
                limited(size, low[1], high[1]),
                limited(rate, low[2], high[2]),
                limited(vertical, low[3], high[3]),
                limited(height, low[4], high[4]),
                limited(held, low[5], high[5]),
                stretched,
                codebook.used[group, spring],
                MOST_OFFSET,
            )
            stiffness[group, spring] = wp.cw_mul(factor, codebook.anchors[group, spring])
            most = wp.max(most, factor)
    largest[group, thread] = most
