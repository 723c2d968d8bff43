"""Bending of a rod: what holds the nodes of its centre line as they are at rest, and damps how they turn.

At node i, between pieces of lengths h_i and h_i+1, the line turns by t = (x_i+1 - x_i) / h_i+1 - (x_i - x_i-1) / h_i.
Over the length H = (h_i + h_i+1) / 2 that it stands for it stores EI |t|^2 / 2H; for pieces that do not stretch this is
the bending energy of a straight discrete elastic rod (Bergou et al., ACM Trans. Graphics 27 (2008) 63). A material
that is damped as Kelvin and Voigt's resists dt/dt across the line in the same way. A natural bend and twist add forces
that are found once a frame (`rod_sections.py`).
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from egophys_core.kinds.rod_curve import fastest_bending
from egophys_core.lanes import Lanes, pack
from egophys_core.lanes.state import StateArrays
from egophys_core.simulation.batch import Rods
from egophys_core.simulation.terms.rod_sections import SECTION_NUMBERS, RodArrays
from egophys_core.twin import PhysicalParameters, level_axes

TORSION_RATIO = 2.0 / 3.0
"""GJ / EI of a round rod of a material that keeps its volume."""


@wp.func
def turn(group: int, node: int, axis: int, back: Lanes, onward: Lanes, of: wp.array3d(dtype=Lanes)) -> Lanes:
    """One coordinate of the turn at a node, between pieces of inverse lengths 1/m, or with velocities of its change."""
    here = of[group, node, axis]
    return wp.cw_mul(onward, of[group, node + 1, axis] - here) - wp.cw_mul(back, here - of[group, node - 1, axis])


@wp.func
def add_bending_forces(
    group: int,
    first: int,
    last: int,
    nodes: int,
    state: StateArrays,
    rods: RodArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Add the forces of the turns at nodes first..last-1 to these and their neighbours, N, and those of sections."""
    rigidity = rods.rigidity[group]
    viscosity = rods.viscosity[group]
    for node in range(first, last):
        for axis in range(3):
            forces[group, node, axis] += rods.forces[group, node, axis]
    one = Lanes(1.0)
    for node in range(wp.max(first, 1), wp.min(last, nodes - 1)):
        length = rods.lengths[group, node - 1]
        next_length = rods.lengths[group, node]
        back = wp.cw_div(one, length)
        onward = wp.cw_div(one, next_length)
        stood_for = 0.5 * (length + next_length)
        stiff = wp.cw_div(rigidity, stood_for)
        viscous = wp.cw_div(viscosity, stood_for)
        # The change of a turn along the line is that of what is bent and turns as one piece; it is not damped.
        along = Lanes()
        squared = Lanes()
        for axis in range(3):
            chord = state.positions[group, node + 1, axis] - state.positions[group, node - 1, axis]
            squared += wp.cw_mul(chord, chord)
            along += wp.cw_mul(chord, turn(group, node, axis, back, onward, state.velocities))
        along = wp.cw_div(along, squared)
        for axis in range(3):
            chord = state.positions[group, node + 1, axis] - state.positions[group, node - 1, axis]
            turning = turn(group, node, axis, back, onward, state.velocities) - wp.cw_mul(along, chord)
            moment = wp.cw_mul(stiff, turn(group, node, axis, back, onward, state.positions))
            moment += wp.cw_mul(viscous, turning)
            forces[group, node - 1, axis] -= wp.cw_mul(back, moment)
            forces[group, node, axis] += wp.cw_mul(back + onward, moment)
            forces[group, node + 1, axis] -= wp.cw_mul(onward, moment)


def rod_bending(
    parameters: Sequence[PhysicalParameters],
    lengths: np.ndarray,
    masses: np.ndarray,
    starts: np.ndarray,
    far_clamps: np.ndarray,
) -> Rods:
    """The bending of K rods.

    Args:
        lengths: [K, N - 1] metres of the pieces between nodes.
        masses: [K, N] kg.
        starts: [K, N, 3] metres, where the nodes lie at the start: a rod's axis is the way from its first to its last.
        far_clamps: [K] whether a clamp holds the last node.
    """
    stiff = np.array([each.flexural_rigidity for each in parameters])
    viscous = stiff * np.array([each.retardation_time for each in parameters])
    axes = np.array([level_axes(start[-1] - start[0]) for start in starts])
    bends = np.array([[each.natural_bend_level, each.natural_bend_up] for each in parameters])
    fastest = np.array([fastest_bending(*each) for each in zip(lengths, masses, strict=True)])
    return Rods(
        rigidity=stiff,
        viscosity=viscous,
        torsion=TORSION_RATIO * stiff,
        far_clamps=np.asarray(far_clamps, bool),
        bends=np.einsum("kb,kbi->ki", bends, axes[:, 1:]),
        axes=axes[:, 0],
        lengths=lengths,
        rates=np.stack([fastest * stiff, fastest * viscous], axis=1),
    )


def rod_arrays(rods: Rods | None, device: str) -> RodArrays:
    """Rods on a device, with sections that are not turned yet; nothing to bend if there are none."""
    arrays = RodArrays()
    if rods is None:
        return arrays
    arrays.bend = 1
    for name in ("rigidity", "viscosity", "torsion", "far_clamps", "bends", "axes", "lengths"):
        setattr(arrays, name, wp.array(pack(getattr(rods, name)), dtype=Lanes, device=device))
    shape = (arrays.rigidity.shape[0], rods.lengths.shape[1] + 1)
    arrays.forces = wp.zeros((*shape, 3), dtype=Lanes, device=device)
    arrays.sections = wp.zeros((*shape, SECTION_NUMBERS), dtype=Lanes, device=device)
    return arrays
