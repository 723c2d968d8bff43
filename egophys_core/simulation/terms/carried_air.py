"""Air that a thin object carries along its normal (added mass)."""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays

SMALLEST_SQUARE = 1.0e-18
"""m^4: guards the division by the square of a normal; a node without neighbours across has none."""


@wp.func
def carried_share(added_mass: Lanes, along: Lanes, square: Lanes) -> Lanes:
    """r / (1 + r) of a component along a normal, over the square of that normal's length."""
    share = Lanes()
    for lane in range(LANES):
        ratio = added_mass[lane]
        share[lane] = ratio / (1.0 + ratio) * along[lane] / wp.max(square[lane], SMALLEST_SQUARE)
    return share


@wp.func
def kick_with_air(
    group: int,
    node: int,
    x: Lanes,
    y: Lanes,
    z: Lanes,
    positions: wp.array3d(dtype=Lanes),
    parameters: ParameterArrays,
):
    """The velocity change (x, y, z) of a node, m/s, less what the air that it carries keeps of it.

    (m + m_a n n^T) a = F, so a is F / m less the share m_a / (m + m_a) of its component along the normal n.
    """
    if parameters.across.shape[0] == 0:
        return x, y, z
    a = parameters.across[node, 0]
    b = parameters.across[node, 1]
    c = parameters.across[node, 2]
    d = parameters.across[node, 3]
    ux = positions[group, b, 0] - positions[group, a, 0]
    uy = positions[group, b, 1] - positions[group, a, 1]
    uz = positions[group, b, 2] - positions[group, a, 2]
    wx = positions[group, d, 0] - positions[group, c, 0]
    wy = positions[group, d, 1] - positions[group, c, 1]
    wz = positions[group, d, 2] - positions[group, c, 2]
    nx = wp.cw_mul(uy, wz) - wp.cw_mul(uz, wy)
    ny = wp.cw_mul(uz, wx) - wp.cw_mul(ux, wz)
    nz = wp.cw_mul(ux, wy) - wp.cw_mul(uy, wx)
    along = wp.cw_mul(x, nx) + wp.cw_mul(y, ny) + wp.cw_mul(z, nz)
    square = wp.cw_mul(nx, nx) + wp.cw_mul(ny, ny) + wp.cw_mul(nz, nz)
    share = carried_share(parameters.added_mass[group], along, square)
    return x - wp.cw_mul(share, nx), y - wp.cw_mul(share, ny), z - wp.cw_mul(share, nz)
